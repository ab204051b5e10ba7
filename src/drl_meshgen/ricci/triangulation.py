"""Intrinsic triangulations as glued triangles with log edge lengths, and their Delaunay flips.

Slot `3 f + k` is the side of face `f` opposite its corner `k`; it runs from corner `k + 1` to corner `k + 2`
(mod 3). Vertices are only labels: two faces may share two sides and an edge may join a vertex to itself.

Sources: Springborn, Schröder, Pinkall, "Conformal equivalence of triangle meshes", 2008; Gillespie, Springborn,
Crane, "Discrete conformal equivalence of polyhedral surfaces", 2021 (Ptolemy flips).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import TriMesh

NEXT, LAST = [1, 2, 0], [2, 0, 1]
DELAUNAY_TOLERANCE = 1e-11
MAX_ROUNDS = 500


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles glued along slots, with the logarithm of each side's length before scaling.

    Both slots of an inner edge carry the same log length. `glue[s]` is the slot on the other side, -1 at the boundary.
    """

    faces: Int[np.ndarray, "f 3"]
    glue: Int[np.ndarray, " 3f"]
    log_lengths: Float[np.ndarray, "f 3"]

    @classmethod
    def of(cls, surface: TriMesh) -> "Triangulation":
        """Return the triangulation of an oriented manifold surface with its own edge lengths.

        Raises `ValueError` where an edge has no length.
        """
        topology = surface.topology
        short = np.nonzero(~(surface.edge_lengths > 0))[0]
        if len(short):
            raise ValueError(f"edges without length between vertices {topology.edges[short[:10]].tolist()}")
        edge_of_slot = topology.face_edges[:, NEXT].ravel()
        order = np.argsort(edge_of_slot, kind="stable")
        glue = np.full(len(order), -1)
        twin = np.nonzero(edge_of_slot[order][1:] == edge_of_slot[order][:-1])[0]
        glue[order[twin]], glue[order[twin + 1]] = order[twin + 1], order[twin]
        log_lengths = np.log(surface.edge_lengths)[edge_of_slot].reshape(-1, 3)
        return cls(surface.triangles, glue, log_lengths)

    @property
    def tails(self) -> Int[np.ndarray, "f 3"]:
        """First vertex of each slot."""
        return self.faces[:, NEXT]

    @property
    def heads(self) -> Int[np.ndarray, "f 3"]:
        """Second vertex of each slot."""
        return self.faces[:, LAST]

    def scaled(self, u: Float[np.ndarray, " v"]) -> Float[np.ndarray, "f 3"]:
        """Log lengths of the metric `l_ij exp((u_i + u_j) / 2)`."""
        half = u[self.faces] / 2
        return self.log_lengths + half[:, NEXT] + half[:, LAST]


@dataclass(frozen=True, eq=False)
class Corners:
    """Angles (radians) and half cotangents of triangles, by slot: the corner opposite the side.

    A triangle that breaks the triangle inequality has the angle pi opposite its longest side, 0 elsewhere and
    cotangents 0, which extends the energy of eq. 4 to a convex function of all `u`.
    """

    angles: Float[np.ndarray, "f 3"]
    half_cotangents: Float[np.ndarray, "f 3"]
    broken: Bool[np.ndarray, " f"]


def relative_lengths(log_lengths: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Side lengths divided by the longest side of their triangle: safe from under- and overflow."""
    first, second, third = log_lengths.T
    return np.exp(log_lengths - np.maximum(np.maximum(first, second), third)[:, None])


def cosines(log_lengths: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Cosine opposite each side by eq. 1; beyond [-1, 1] where the triangle inequality is broken."""
    a = relative_lengths(log_lengths)
    b, c = a[:, NEXT], a[:, LAST]
    return (b * b + c * c - a * a) / (2 * b * c)


def corners(log_lengths: Float[np.ndarray, "f 3"]) -> Corners:
    """Angles and half cotangents through the inradius, accurate for needles too."""
    a = relative_lengths(log_lengths)
    b, c = a[:, NEXT], a[:, LAST]
    tangent = (b + c - a) / 2  # from the corner to the points where the incircle touches
    x, y, z = tangent.T
    broken = np.minimum(np.minimum(x, y), z) <= 0
    half_perimeter = x + y + z
    inradius = np.sqrt(np.where(broken, 1.0, x * y * z / half_perimeter))[:, None]
    angles = 2 * np.arctan2(inradius, tangent)
    half_cotangents = (b * b + c * c - a * a) / (8 * inradius * half_perimeter[:, None])
    if broken.any():
        angles[broken] = np.pi * (np.arange(3) == a[broken].argmax(axis=1)[:, None])
        half_cotangents[broken] = 0.0
    return Corners(angles, half_cotangents, broken)


def _euclidean_diagonal(log_lengths: np.ndarray, slot: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Log length of the other diagonal when the two triangles at each slot lie in the plane."""
    f, k, g, m = slot // 3, slot % 3, twin // 3, twin % 3
    at_tail = corners(log_lengths[f]).angles[np.arange(len(f)), (k + 1) % 3]
    at_tail = at_tail + corners(log_lengths[g]).angles[np.arange(len(g)), (m + 2) % 3]
    p, q = np.exp(log_lengths[f, (k + 2) % 3]), np.exp(log_lengths[g, (m + 1) % 3])
    return np.log((p - q) ** 2 + 4 * p * q * np.sin(at_tail / 2) ** 2) / 2


def _ptolemy_diagonal(log_lengths: np.ndarray, slot: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Log length of the other diagonal when the two triangles at each slot lie on one circle."""
    f, k, g, m = slot // 3, slot % 3, twin // 3, twin % 3
    first = log_lengths[f, (k + 2) % 3] + log_lengths[g, (m + 2) % 3]
    second = log_lengths[f, (k + 1) % 3] + log_lengths[g, (m + 1) % 3]
    return np.logaddexp(first, second) - log_lengths[f, k]


def flip(
    triangulation: Triangulation, slot: Int[np.ndarray, " n"], log_diagonal: Float[np.ndarray, " n"]
) -> Triangulation:
    """Replace the edges at the given slots by the other diagonals. No two of them may share a face.

    Faces `(a, b, c)` and `(d, c, b)` at the edge `bc` become `(a, b, d)` and `(d, c, a)`.
    """
    t = triangulation
    twin = t.glue[slot]
    f, k, g, m = slot // 3, slot % 3, twin // 3, twin % 3
    a, b, c, d = t.faces[f, k], t.faces[f, (k + 1) % 3], t.faces[f, (k + 2) % 3], t.faces[g, m]
    faces = t.faces.copy()
    faces[f], faces[g] = np.c_[a, b, d], np.c_[d, c, a]
    moved = np.arange(len(t.glue))
    moved[slot], moved[twin] = 3 * f + 1, 3 * g + 1
    moved[3 * f + (k + 1) % 3], moved[3 * f + (k + 2) % 3] = 3 * g, 3 * f + 2
    moved[3 * g + (m + 1) % 3], moved[3 * g + (m + 2) % 3] = 3 * f, 3 * g + 2
    glue, log_lengths = np.empty_like(t.glue), np.empty_like(t.log_lengths)
    glue[moved] = np.where(t.glue >= 0, moved[t.glue], -1)
    log_lengths.ravel()[moved] = t.log_lengths.ravel()
    log_lengths[f, 1] = log_lengths[g, 1] = log_diagonal
    return Triangulation(faces, glue, log_lengths)


def _worst_first(cosine: np.ndarray, glue: np.ndarray) -> np.ndarray:
    """Slots to flip together: edges that are not Delaunay and the worst of both their faces."""
    inner = np.nonzero((glue > np.arange(len(glue))) & (glue // 3 != np.arange(len(glue)) // 3))[0]
    cosine = cosine.ravel()
    excess = cosine[inner] + cosine[glue[inner]]
    bad = excess < -DELAUNAY_TOLERANCE
    slot = inner[bad][np.argsort(excess[bad], kind="stable")]
    rank = np.arange(len(slot))
    best = np.full(len(glue) // 3, len(slot))
    for side in (slot, glue[slot]):
        np.minimum.at(best, side // 3, rank)
    return slot[(best[slot // 3] == rank) & (best[glue[slot] // 3] == rank)]


def _flip_to_delaunay(
    triangulation: Triangulation, u: np.ndarray, diagonal: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
) -> tuple[Triangulation, int]:
    flips = 0
    for _ in range(MAX_ROUNDS):
        slot = _worst_first(cosines(triangulation.scaled(u)), triangulation.glue)
        if not len(slot):
            break
        new = diagonal(triangulation.log_lengths, slot, triangulation.glue[slot])
        triangulation = flip(triangulation, slot, new)
        flips += len(slot)
    return triangulation, flips


def intrinsic_delaunay(triangulation: Triangulation) -> tuple[Triangulation, int]:
    """Flip to the intrinsic Delaunay triangulation of the same piecewise flat metric (at `u = 0`).

    Returns the triangulation and the number of flips. Boundary edges stay.
    """
    return _flip_to_delaunay(triangulation, np.zeros(triangulation.faces.max() + 1), _euclidean_diagonal)


def ptolemy_delaunay(triangulation: Triangulation, u: Float[np.ndarray, " v"]) -> tuple[Triangulation, int]:
    """Flip to the Delaunay triangulation of the metric scaled by `u`, staying in the discrete conformal class.

    Works on the unscaled lengths (Ptolemy's relation is homogeneous in each vertex), so flips need not be undone when
    `u` is. Valid through broken triangles. Returns the triangulation and the number of flips.
    """
    return _flip_to_delaunay(triangulation, u, _ptolemy_diagonal)
