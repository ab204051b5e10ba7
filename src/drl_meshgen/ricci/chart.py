"""Planar layout of a flat triangulation: Algorithm 1 of the paper, whole or one region in its own scale."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order

from drl_meshgen.ricci.flow import FlatTriangulation
from drl_meshgen.ricci.triangulation import corners


@dataclass(frozen=True, eq=False)
class Chart:
    """Positions in the plane of some faces of a flat triangulation, anti-clockwise like the faces themselves.

    Lengths are those of the flat metric times `exp(-u_ref)`; the smallest face has its first corner at the origin and
    its first side along the first axis.
    """

    faces: Int[np.ndarray, " n"]
    """Faces of the triangulation that are laid out, increasing."""
    corners: Float[np.ndarray, "n 3 2"]
    """Corner positions of each of them."""
    vertices: Float[np.ndarray, "v 2"]
    """Mean position of each vertex over its corners in `faces`; NaN where there is none."""
    closing_error: float
    """Largest gap at a glued side, relative to that side's length: round-off for a flat disk, of order one for a
    metric with curvature or around a hole that turns."""

    @property
    def inverted(self) -> Bool[np.ndarray, " n"]:
        """Faces that lie clockwise or have no area: what is left where precision ran out."""
        a, b = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0


def faces_around(triangulation: FlatTriangulation, vertices: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Return the faces with at least one corner among `vertices`, increasing."""
    wanted = np.zeros(triangulation.faces.max() + 1, bool)
    wanted[vertices] = True
    return np.nonzero(wanted[triangulation.faces].any(axis=1))[0]


def lay_out(triangulation: FlatTriangulation, faces: Int[np.ndarray, " n"] | None = None, u_ref: float = 0.0) -> Chart:
    """Embed faces in the plane, breadth-first from the smallest one (Algorithm 1).

    `faces` (default: all) must be connected through glued sides. `u_ref`, log scale units, is best taken in the middle
    of the range of u in the region: precision is lost with the range, 2e-9 of the local edge at 12 units.

    Raises `ValueError` for an empty or disconnected set of faces and for triangles that break the triangle inequality.
    """
    t = triangulation
    faces = np.arange(len(t.faces)) if faces is None else np.unique(faces)
    if not len(faces):
        raise ValueError("a chart needs at least one face")
    log_lengths = np.log(t.lengths[faces]) - u_ref
    glue = restricted_glue(t.glue, faces)
    shape, area = _own_frames(log_lengths, faces)
    first = int(area.argmin())
    parent, slot = _tree(glue, first)
    scale, shift = _place(shape, glue, parent, slot)
    placed = scale[:, None] * shape + shift[:, None]
    positions = np.stack([np.real(placed), np.imag(placed)], axis=-1)
    error = _closing_error(placed, glue, np.exp(log_lengths).ravel())
    return Chart(faces, positions, _vertex_means(t.faces[faces], positions), error)


def restricted_glue(glue: Int[np.ndarray, " 3f"], faces: Int[np.ndarray, " n"]) -> Int[np.ndarray, " 3n"]:
    """Return the gluing among the given faces only, renumbered to 0 .. n - 1; -1 at sides that become boundary."""
    index = np.full(len(glue) // 3, -1)
    index[faces] = np.arange(len(faces))
    across = glue.reshape(-1, 3)[faces].ravel()
    inside = (across >= 0) & (index[across // 3] >= 0)
    return np.where(inside, 3 * index[across // 3] + across % 3, -1)


def _own_frames(log_lengths: np.ndarray, faces: np.ndarray) -> tuple[Complex[np.ndarray, "n 3"], np.ndarray]:
    """Each face with corner 0 at the origin and corner 1 on the positive axis, and its area."""
    at = corners(log_lengths)
    if at.broken.any():
        raise ValueError(f"triangle inequality broken in faces {faces[at.broken][:10].tolist()}")
    lengths = np.exp(log_lengths)
    direction = np.exp(1j * at.angles[:, 0])
    shape = np.stack([np.zeros(len(faces)), lengths[:, 2] + 0j, lengths[:, 1] * direction], axis=1)
    return shape, lengths[:, 2] * lengths[:, 1] * np.sin(at.angles[:, 0]) / 2


def _tree(glue: np.ndarray, first: int) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Parent of each face in the breadth-first tree (the root's own is itself) and the slot towards it."""
    n = len(glue) // 3
    slot = np.nonzero(glue >= 0)[0]
    graph = coo_matrix((np.ones(len(slot), np.int8), (slot // 3, glue[slot] // 3)), (n, n)).tocsr()
    order, parent = breadth_first_order(graph, first, directed=False)
    if len(order) < n:
        raise ValueError(f"the {n} faces of a chart must be connected; {n - len(order)} are not reached")
    parent = parent.astype(np.int64)  # scipy answers int32: products overflow
    parent[first] = first
    towards = np.where(glue >= 0, glue // 3, -1).reshape(-1, 3) == parent[:, None]
    return parent, 3 * np.arange(n) + towards.argmax(axis=1)


def _place(
    shape: np.ndarray, glue: np.ndarray, parent: np.ndarray, slot: np.ndarray
) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
    """Similarity `z -> scale z + shift` of each face into the root's frame.

    The maps along the tree are composed by pointer jumping: after k rounds a face knows its map into the frame of its
    ancestor of order 2^k, so the number of rounds is the logarithm of the tree's depth.
    """
    n = len(parent)
    moved = parent != np.arange(n)
    scale, shift = np.ones(n, complex), np.zeros(n, complex)
    s, t = slot[moved], glue[slot[moved]]
    tail, head = shape[s // 3, (s + 1) % 3], shape[s // 3, (s + 2) % 3]
    new_tail, new_head = shape[t // 3, (t + 2) % 3], shape[t // 3, (t + 1) % 3]
    scale[moved] = (new_head - new_tail) / (head - tail)
    shift[moved] = new_tail - scale[moved] * tail
    while np.any(parent != parent[parent]):
        shift = scale[parent] * shift + shift[parent]
        scale = scale[parent] * scale
        parent = parent[parent]
    return scale, shift


def _vertex_means(faces: np.ndarray, positions: np.ndarray) -> Float[np.ndarray, "v 2"]:
    n = int(faces.max()) + 1
    count = np.bincount(faces.ravel(), minlength=n)
    total = np.stack([np.bincount(faces.ravel(), positions[..., k].ravel(), n) for k in (0, 1)], axis=1)
    return np.divide(total, count[:, None], out=np.full((n, 2), np.nan), where=count[:, None] > 0)


def _closing_error(placed: Complex[np.ndarray, "n 3"], glue: np.ndarray, lengths: np.ndarray) -> float:
    slot = np.nonzero(glue > np.arange(len(glue)))[0]
    tail, head = placed[slot // 3, (slot + 1) % 3], placed[slot // 3, (slot + 2) % 3]
    other = glue[slot]
    gap = np.maximum(
        np.abs(tail - placed[other // 3, (other + 2) % 3]), np.abs(head - placed[other // 3, (other + 1) % 3])
    )
    return float((gap / lengths[slot]).max(initial=0.0))
