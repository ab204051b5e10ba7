"""A coarse O-type mesh as a linear function of its singular points and bows, for fast descent."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.templates.curves import graded
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.energy import Corners
from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import grids, positions, rim_fractions


def subset(count: int, limit: int) -> Int[np.ndarray, " s"]:
    """Return at most `limit + 1` of the indices 0..count with both ends, the same when counted from either end."""
    parts = min(count, limit)
    parts -= (parts < count) * ((count - parts) % 2)
    half = np.floor(np.arange(parts // 2 + 1) * count / parts + 0.5).astype(np.int64)
    return np.concatenate([half, count - half[::-1]] if parts % 2 else [half, count - half[-2::-1]])


@dataclass(frozen=True, eq=False)
class Sketch:
    """A coarse O-grid on chosen corners: points are `fixed + basis @ [4 singular points, 8 bow vectors]`."""

    i0: int
    m: int
    n: int
    layers: int
    rim: Float[np.ndarray, "l 2"]
    fractions: tuple[np.ndarray, ...]
    steps: Float[np.ndarray, "q 2"]
    outer: np.ndarray
    quads: Int[np.ndarray, "q 4"]

    @classmethod
    def of(cls, domain: Domain, i0: int, m: int, divisions: int, layers: int) -> "Sketch":
        """Return the sketch with at most `divisions` cells per side and `layers` radial cells."""
        n = len(domain) // 2 - m
        first, second = subset(m, divisions), subset(n, divisions)
        keep = np.concatenate([first[:-1], m + second[:-1], m + n + first[:-1], 2 * m + n + second[:-1]])
        rim = domain.nodes[(i0 + keep) % len(domain)]
        a, b = len(first) - 1, len(second) - 1
        du, dv = np.diff(first).astype(float), np.diff(second).astype(float)
        blocks = grids(0, a, b, layers)
        core = np.stack(np.broadcast_arrays(du[:, None], dv), axis=-1).reshape(-1, 2)
        side = [np.repeat(np.c_[d, np.ones(len(d))], layers, axis=0) for d in (du, dv, du, dv)]
        quads = grid_quads(blocks)
        return cls(
            i0, m, n, layers, rim, rim_fractions(rim, 0, a, b), np.concatenate([core, *side]),
            np.arange(len(quads)) >= len(core), quads,
        )  # fmt: skip

    @property
    def n_points(self) -> int:
        """Number of coarse points."""
        _, a, b = self.coarse
        return len(self.rim) * self.layers + (a + 1) * (b + 1)

    @property
    def coarse(self) -> tuple[int, int, int]:
        """First corner and cells per side of the coarse grid."""
        return 0, len(self.fractions[0]) - 1, len(self.fractions[1]) - 1

    @cached_property
    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Positions of the corners."""
        _, a, b = self.coarse
        return self.rim[[0, a, a + b, 2 * a + b]]

    def linear(self, ratio: float) -> tuple[Float[np.ndarray, "p 2"], Float[np.ndarray, "p 12"]]:
        """Return `fixed` and `basis`; the innermost layer is `ratio` times as thick as the outermost."""
        radial = graded(self.layers, ratio ** (1 / max(self.layers - 1, 1)))
        # one interpolation of 2 + 12 coordinates: the given boundary, and each unit vector of the controls
        boundary = np.concatenate([self.rim, np.zeros((len(self.rim), 12))], axis=1)
        unit = np.eye(12, 14, 2)
        bow = np.zeros((8, 2, 14))
        bow[:, 0] = unit[4:]
        both = positions(boundary, unit[:4], bow, corners=self.coarse, radial=radial, fractions=self.fractions)
        return both[:, :2], both[:, 2:]

    def wanted(self, size: Float[np.ndarray, "q 4"], k: Float[np.ndarray, "*k 1 1"] | float) -> Corners:
        """Return wanted corners, flattened to (..., 4 q), of `k` layers of cells of edge length `size`."""
        u, v = self.steps.T[:, :, None]
        v = np.where(self.outer[:, None], v * k / self.layers, v)
        even = np.arange(4) % 2 == 0
        first, second = np.where(even, u, v) * size, np.where(even, v, u) * size
        return Corners.wanted(first.reshape(*first.shape[:-2], -1), second.reshape(*second.shape[:-2], -1))

    def weights(self, k: Float[np.ndarray, "*k 1 1"] | float) -> Float[np.ndarray, "*k c"]:
        """Return the share of each coarse corner, (..., 4 q), in a mean over the cells of the full mesh."""
        cells = (np.prod(self.steps, axis=1) * np.where(self.outer, 1 / self.layers, 1.0))[:, None]
        cells = np.where(self.outer[:, None], cells * k, cells)
        share = np.repeat(cells / (4 * cells.sum(axis=-2, keepdims=True)), 4, axis=-1)
        return share.reshape(*share.shape[:-2], -1)
