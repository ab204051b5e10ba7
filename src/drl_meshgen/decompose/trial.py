"""A trial fill of a junction, to compare ways of opening it by the quads that they lead to.

Counts are the lengths over one spacing, each by itself; the nodes lie where the charts put them, as in the first mesh
that the node optimiser gets.
"""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Cell, spread
from drl_meshgen.decompose.junction import Junction
from drl_meshgen.decompose.strips import Strip
from drl_meshgen.lift.locate import locate, locate_in_ring

#: Quads that would fill a junction if all were square and of one size.
TRIAL_QUADS = 600


def trial_score(junction: Junction) -> float:
    """Mean orthogonality of the trial quads: how square the chosen lines are before the optimiser moves them."""
    return mean_orthogonality(trial_quads(junction))


def mean_orthogonality(quads: Float[np.ndarray, "m 4 3"]) -> float:
    """Mean over quads, given by corners, of `1 - (2 / pi) max |pi / 2 - angle|`."""
    ahead, behind = np.roll(quads, -1, axis=1) - quads, np.roll(quads, 1, axis=1) - quads
    scale = np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2)
    cosine = (ahead * behind).sum(2) / np.maximum(scale, np.finfo(float).tiny)
    return float(1 - 2 / np.pi * np.abs(np.pi / 2 - np.arccos(np.clip(cosine, -1, 1))).max(1).mean())


def trial_quads(junction: Junction) -> Float[np.ndarray, "m 4 3"]:
    """Corners of the quads of all cells and strips, lifted to the surface."""
    area = sum(piece.area for piece in (*(c.ring.mesh for c in junction.cells), *(s.mesh for s in junction.strips)))
    spacing = np.sqrt(area / TRIAL_QUADS)
    wanted = junction.lengths / spacing
    for strip in junction.strips:
        for k in (0, 1):
            wanted[[strip.sides[k], strip.sides[k + 2]]] = wanted[[strip.sides[k], strip.sides[k + 2]]].mean()
    counts = np.maximum(2, np.round(wanted)).astype(np.int64)
    grids = [_cell_nodes(cell, counts, spacing) for cell in junction.cells]
    grids += [_strip_nodes(strip, counts) for strip in junction.strips]
    return np.concatenate(
        [np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 3) for p in grids]
    )


def _cell_nodes(cell: Cell, counts: Int[np.ndarray, " e"], spacing: float) -> Float[np.ndarray, "n1 r1 3"]:
    ring = cell.ring
    outer = cell.outer_theta(counts)
    square = len(outer) * ring.chart.modulus
    height = np.sqrt(ring.mesh.area * ring.chart.modulus)
    rows = max(2, round(float(np.sqrt(square * height / spacing))))
    h = np.arange(rows + 1) / rows
    share = h[:, None]
    theta = (1 - share) * spread(outer) + share * outer
    chart = np.stack([theta, np.broadcast_to(share, theta.shape)], axis=-1).reshape(-1, 2)
    triangle, bary = locate_in_ring(ring.chart.theta_corner, ring.chart.h[ring.mesh.triangles], chart)
    p = np.einsum("qk,qkd->qd", bary, ring.mesh.corners[triangle]).reshape(rows + 1, -1, 3)
    return np.concatenate([p, p[:, :1]], axis=1).swapaxes(0, 1)


def _strip_nodes(strip: Strip, counts: Int[np.ndarray, " e"]) -> Float[np.ndarray, "w1 l1 3"]:
    grid = strip.nodes(counts)
    triangle, bary = locate(strip.plane[strip.mesh.triangles], grid.reshape(-1, 2))
    return np.einsum("qk,qkd->qd", bary, strip.mesh.corners[triangle]).reshape(*grid.shape[:2], 3)
