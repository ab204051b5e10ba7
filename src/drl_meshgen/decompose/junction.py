"""Junctions: regions with three or more loops, opened along a graph."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Cell
from drl_meshgen.decompose.spine import Spine
from drl_meshgen.decompose.strips import Strip


@dataclass(frozen=True, eq=False)
class Rim:
    """A curve that strips start from: graph edges around it, with the junction on the left.

    `corners` is the place on the curve (share of its length, unrolled) where each edge begins; it rises where the curve
    runs the same way and falls where it runs the other way.
    """

    curve: int
    sides: tuple[int, ...]
    corners: Float[np.ndarray, " s"]

    def natural(self, counts: Int[np.ndarray, " e"]) -> Float[np.ndarray, " n"]:
        """Places of nodes around the rim, equally spaced on every edge, `counts` of them on each edge of the graph."""
        turn = np.sign(self.corners[1] - self.corners[0])
        bounds = np.r_[self.corners, self.corners[0] + turn]
        return np.concatenate(
            [np.linspace(a, b, counts[e] + 1)[:-1] for e, a, b in zip(self.sides, bounds, bounds[1:], strict=False)]
        )


@dataclass(frozen=True, eq=False)
class Junction:
    """A region with three or more loops, opened along a graph; `points` are the vertices that its paths refer to.

    Opened along its spine: one cell per loop, whose ids are `curves`. Opened by strips: one cell, that of the outer
    loop; the other loops are `rims`.
    """

    points: Float[np.ndarray, "v 3"]
    spine: Spine
    curves: tuple[int, ...]
    cells: tuple[Cell, ...]
    strips: tuple[Strip, ...] = ()
    rims: tuple[Rim, ...] = ()

    @property
    def lengths(self) -> Float[np.ndarray, " e"]:
        """Length of each edge of the graph (model units)."""
        steps = [np.linalg.norm(np.diff(self.points[path], axis=0), axis=1) for path in self.spine.paths]
        return np.array([step.sum() for step in steps])

    @property
    def distortion(self) -> float:
        """Largest over the cells of the relative entropy between shares of length and of theta along the outer loop.

        0 when theta runs evenly along the outer loop; large when much of it sits in a pocket of its cell, where
        the columns of a chart crowd.
        """
        lengths = self.lengths
        worst = 0.0
        for cell in self.cells:
            share = lengths[[edge for edge, _ in cell.sides]]
            share = share / share.sum()
            worst = max(worst, float((share * np.log(share / np.maximum(cell.theta_shares, 1e-9))).sum()))
        return worst
