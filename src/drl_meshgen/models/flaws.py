"""Flaws of triangulations that cleanup has to cope with: none of them changes the surface that is meant."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.mesh import TriMesh

Points = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "m 3"]
Flaw = Callable[[Points, Faces, np.random.Generator], tuple[Points, Faces]]
"""`flaw(points, faces, rng)`: the same surface, triangulated worse."""


def _some(count: int, share: float, rng: np.random.Generator) -> Int[np.ndarray, " k"]:
    """Return sorted numbers below `count`, about a `share` of them, at least one."""
    return np.sort(rng.choice(count, max(1, round(share * count)), replace=False))


def size_jumps(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Remesh a patch of the surface with edges a tenth to a quarter as long."""
    mesh = TriMesh(points, faces)
    edge = float(mesh.edge_lengths.mean()) * rng.uniform(0.1, 0.25)
    budget = min(2500, len(faces) // 4) * np.sqrt(3) / 4 * edge**2
    centre = mesh.corners.mean(axis=1)
    near = np.argsort(np.linalg.norm(centre - centre[rng.integers(len(faces))], axis=1), kind="stable")
    chosen = np.zeros(len(faces), bool)
    chosen[near[: max(8, int(np.searchsorted(np.cumsum(mesh.areas[near]), budget)))]] = True
    return remesh_isotropic(points, faces, edge, selected=chosen)


def needles(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Split one triangle in fifty at a point within it that almost lies on a side or on a corner."""
    chosen = _some(len(faces), 0.02, rng)
    small = 10 ** rng.uniform(-3, -1.3, (len(chosen), 2))
    weight = np.c_[small, 1 - small.sum(axis=1)]
    weight[rng.random(len(chosen)) < 0.5, 1] += 0.4
    weight[:, 2] = 1 - weight[:, :2].sum(axis=1)
    a, b, c = faces[chosen].T
    new = len(points) + np.arange(len(chosen))
    split = np.concatenate([np.c_[a, b, new], np.c_[b, c, new], np.c_[c, a, new]])
    inside = np.einsum("nk,nkd->nd", weight, points[faces[chosen]])
    return np.concatenate([points, inside]), np.concatenate([np.delete(faces, chosen, axis=0), split])


def fins(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Put a loose triangle on each of a few edges."""
    mesh = TriMesh(points, faces)
    inner = np.nonzero(mesh.topology.edge_count == 2)[0]
    chosen = inner[_some(len(inner), 0.001, rng)]
    a, b = mesh.topology.edges[chosen].T
    tip = points[[a, b]].mean(axis=0) + mesh.vertex_normals[a] * mesh.edge_lengths[chosen, None]
    new = len(points) + np.arange(len(chosen))
    return np.concatenate([points, tip]), np.concatenate([faces, np.c_[a, b, new]])


def duplicates(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Repeat one face in a hundred, with other first corners."""
    again = np.roll(faces[_some(len(faces), 0.01, rng)], 1, axis=1)
    return points, np.concatenate([faces, again])


def flipped(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Turn up to a fifth of the faces over."""
    faces = faces.copy()
    chosen = _some(len(faces), rng.uniform(0.001, 0.2), rng)
    faces[chosen] = faces[chosen, ::-1]
    return points, faces


def shuffled(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:
    """Put points and faces in random order."""
    old = rng.permutation(len(points))
    return points[old], np.argsort(old)[faces][rng.permutation(len(faces))]


def soup(points: Points, faces: Faces, rng: np.random.Generator) -> tuple[Points, Faces]:  # noqa: ARG001
    """Give each face points of its own, as STL files do."""
    return points[faces.ravel()], np.arange(faces.size).reshape(-1, 3)


FLAWS: dict[str, Flaw] = {
    flaw.__name__: flaw for flaw in (size_jumps, needles, fins, duplicates, flipped, shuffled, soup)
}
"""All flaws by name, in the order in which they are applied."""
