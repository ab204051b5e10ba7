"""Random surfaces, for tests of robustness: limbs, handles, openings, noise and bad triangles, all from one seed."""

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.flaws import FLAWS
from drl_meshgen.models.random_body import Body, drawn_body
from drl_meshgen.models.sampling import clipped, contour, largest_component
from drl_meshgen.models.surface import RawSurface

PREFIX = "random:"
SMALLEST, LARGEST = 3_000, 12_000
"""Triangles of all components together before their flaws, which add up to a quarter."""
APART = 10.0
"""Distance of the centres of neighbouring components, body radii."""
STEP = 0.1
"""Grid step of the contour in body radii."""
REMESHED, CLOSED, SPOILT = 0.8, 0.2, 0.55
"""Shares of surfaces that are remeshed isotropically, that have no opening, that have flaws."""


@dataclass(frozen=True, eq=False)
class RandomSurface:
    """A surface and what is known about it."""

    surface: RawSurface
    """The triangles as a user would hand them in, flaws included."""
    limbs: int
    """Limbs asked for; some may lose their tip to an opening."""
    genus: int
    """Handles of all components together, counted on the mesh before its flaws."""
    loops: int
    """Boundary loops of all components together, counted likewise."""
    components: int
    """Components, counted likewise."""
    flaws: tuple[str, ...]
    """Names of the flaws, keys of `flaws.FLAWS`."""


def is_random(name: str) -> bool:
    """Tell whether a name asks for a random surface, well formed or not."""
    return name.startswith(PREFIX)


def seed_of(name: str) -> int:
    """Return the seed in `random:SEED`; raises `InputError` where it is not a whole number."""
    if not re.fullmatch(r"\d{1,9}", name.removeprefix(PREFIX)):
        raise InputError(name, "the seed of a random surface is a whole number of up to nine digits", "try random:17")
    return int(name.removeprefix(PREFIX))


@lru_cache(maxsize=1)
def random_surface(seed: int) -> RandomSurface:
    """Return the random surface of a seed: the same bytes each time; the last one is kept.

    One to three separate bodies (blobs or rings), together with 2 to 12 limbs per body, up to 3 arches (each a
    handle) and up to 6 openings, 3,000 to 15,000 triangles. Handles and loops can come out otherwise than drawn where
    limbs touch; the facts are therefore counted on the mesh.
    """
    rng = np.random.default_rng(seed)
    bodies = int(rng.choice([1, 2, 3], p=[0.85, 0.1, 0.05]))
    triangles = int(rng.integers(SMALLEST, LARGEST))
    remeshed, closed = rng.random() < REMESHED, rng.random() < CLOSED
    limbs, parts = 0, []
    for k in range(bodies):
        body = drawn_body(rng, closed=closed)
        limbs += body.limbs
        mesh = _triangulated(body, triangles // bodies, remeshed=remeshed)
        parts.append(TriMesh(mesh.vertices + np.array([APART * k, 0, 0]), mesh.triangles))
    mesh = _roughened(_joined(parts), rng)
    flaws = _drawn_flaws(rng)
    points, faces = mesh.vertices, mesh.triangles
    for name in flaws:
        points, faces = FLAWS[name](points, faces, rng)
    t = mesh.topology
    genus = (2 * t.components[0] - t.euler - len(t.loops)) // 2
    raw = RawSurface(f"random-{seed}", _placed(points, rng), faces)
    return RandomSurface(raw, limbs, genus, len(t.loops), t.components[0], flaws)


def _triangulated(body: Body, triangles: int, *, remeshed: bool) -> TriMesh:
    """Contour the body, cut its openings, keep the largest piece; about `triangles` of them where remeshed."""
    low, high = body.bounds
    mesh = TriMesh(*contour(body.field, tuple(low), tuple(high), STEP))
    if not remeshed:  # the slivers of marching cubes stay, at a step that gives the wanted number
        step = STEP * np.sqrt(len(mesh.triangles) / triangles)
        mesh = TriMesh(*contour(body.field, tuple(low), tuple(high), float(step)))
    if body.cuts:
        mesh = clipped(mesh, body.opening)
    mesh = largest_component(mesh)
    if not remeshed:
        return mesh
    edge = float(np.sqrt(4 / np.sqrt(3) * mesh.area / triangles))
    return largest_component(TriMesh(*remesh_isotropic(mesh.vertices, mesh.triangles, edge)))


def _joined(parts: list[TriMesh]) -> TriMesh:
    start = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + first for part, first in zip(parts, start, strict=True)]
    return TriMesh(np.concatenate([part.vertices for part in parts]), np.concatenate(triangles))


def _roughened(mesh: TriMesh, rng: np.random.Generator) -> TriMesh:
    """Move vertices along their normals, by up to a quarter of the mean edge on half of the surfaces."""
    height = float(rng.choice([0, 0, 0.05, 0.25])) * mesh.edge_lengths.mean()
    shift = height * rng.uniform(-1, 1, len(mesh.vertices))
    return TriMesh(mesh.vertices + shift[:, None] * mesh.vertex_normals, mesh.triangles)


def _drawn_flaws(rng: np.random.Generator) -> tuple[str, ...]:
    """Up to three flaws in the order of `FLAWS`."""
    if rng.random() >= SPOILT:
        return ()
    chosen = rng.choice(len(FLAWS), size=int(rng.integers(1, 4)), replace=False)
    return tuple(name for k, name in enumerate(FLAWS) if k in chosen)


def _placed(points: Float[np.ndarray, "n 3"], rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Rotate at random and scale to some unit between a hundredth and a hundred."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return 10 ** rng.uniform(-2, 2) * (points @ q.T)
