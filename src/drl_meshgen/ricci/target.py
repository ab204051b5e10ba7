"""Target curvatures of the Ricci flow and the Newton steps that belong to them."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.ricci.hessian import Pattern, StaleFactor, factorise
from drl_meshgen.ricci.triangulation import Corners, Triangulation

BROKEN_RIDGE = 1e-10
MOBIUS_RIDGE = 1e-7


@dataclass(frozen=True)
class LinearSolve:
    """What one Newton step's linear system cost."""

    iterations: int
    refactored: bool


class Target(Protocol):
    """A boundary condition: which vertices move, the curvature they shall get, and Newton's step towards it."""

    free: Int[np.ndarray, " n"]
    convex: bool
    """Whether `K - K_target` is the gradient of a convex function, so that steps through broken triangles are safe."""

    def curvature(self, triangulation: Triangulation, u: Float[np.ndarray, " v"]) -> Float[np.ndarray, " n"]:
        """Return the target curvature of the free vertices in radians; NaN where the metric admits none."""
        ...

    def step(
        self,
        pattern: Pattern,
        triangulation: Triangulation,
        corners: Corners,
        u: Float[np.ndarray, " v"],
        residual: Float[np.ndarray, " n"],
    ) -> tuple[Float[np.ndarray, " n"], LinearSolve]:
        """Return the change of `u` at the free vertices that makes `residual = K - K_target` vanish to first order."""
        ...


class FreeBoundary:
    """Flat inside, `u = 0` on the boundary: isometric boundary, whose curvature comes out of the flow."""

    convex = True

    def __init__(self, free: Int[np.ndarray, " n"]) -> None:
        self.free = free
        self._solver = StaleFactor()

    def curvature(self, triangulation: Triangulation, u: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return zero: flat."""
        return np.zeros(len(self.free))

    def step(
        self,
        pattern: Pattern,
        triangulation: Triangulation,  # noqa: ARG002
        corners: Corners,
        u: np.ndarray,  # noqa: ARG002
        residual: np.ndarray,
    ) -> tuple[np.ndarray, LinearSolve]:
        """Take Newton's step by one stale factor and conjugate gradients."""
        weight = corners.half_cotangents.ravel()
        ridge = BROKEN_RIDGE * float(np.abs(weight).mean()) if corners.broken.any() else 0.0
        tolerance = max(1e-13, min(1e-2, float(np.abs(residual).max())))
        du, iterations, refactored = self._solver.solve(pattern.matrix(weight, -weight, ridge), -residual, tolerance)
        return du, LinearSolve(iterations, refactored)


class InscribedDisk:
    """Flat inside, boundary vertices on one circle: the boundary is an inscribed polygon.

    The turning angle at a boundary vertex between edges of lengths `l` and `m` is `asin(l / 2R) + asin(m / 2R)`, where
    R solves `sum 2 asin(l / 2R) = 2 pi`. (The smooth `2 pi l / L` fits no polygon.) Determined up to a Möbius map of
    the disk and a scale; the step is the one that changes R least, and short along the Möbius directions.
    """

    convex = False

    def __init__(self, free: Int[np.ndarray, " n"], triangulation: Triangulation, n_vertices: int) -> None:
        self.free, self._n = free, n_vertices
        slot = np.nonzero(triangulation.glue < 0)[0]
        self._tails, self._heads = triangulation.tails.ravel()[slot], triangulation.heads.ravel()[slot]
        self._log_lengths = triangulation.log_lengths.ravel()[slot]  # boundary edges are never flipped

    def _polygon(self, u: np.ndarray) -> tuple[np.ndarray, float]:
        """Edge lengths relative to the longest and the circumradius (NaN where the centre is outside)."""
        log_lengths = self._log_lengths + (u[self._tails] + u[self._heads]) / 2
        lengths = np.exp(log_lengths - log_lengths.max())
        if not np.all(np.isfinite(lengths)) or np.arcsin(lengths).sum() <= np.pi:
            return lengths, np.nan
        # s = longest / R; the sum of arcsin(l s / 2) is increasing and convex in s: Newton from the right of the root
        s = min(2.0, 2 * np.pi / lengths.sum())
        for _ in range(60):
            x = np.minimum(lengths * s / 2, 1 - 1e-16)
            change = (np.arcsin(x).sum() - np.pi) / (lengths / (2 * np.sqrt(1 - x * x))).sum()
            s -= change
            if abs(change) < 1e-15 * s:
                break
        return lengths, 1 / s

    def curvature(self, triangulation: Triangulation, u: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return the turning angles of the inscribed polygon with the current edge lengths; zero inside."""
        lengths, radius = self._polygon(u)
        half = np.arcsin(np.clip(lengths / (2 * radius), -1, 1))
        total = np.bincount(self._tails, half, self._n) + np.bincount(self._heads, half, self._n)
        return total[self.free]

    def step(
        self,
        pattern: Pattern,
        triangulation: Triangulation,
        corners: Corners,
        u: np.ndarray,
        residual: np.ndarray,
    ) -> tuple[np.ndarray, LinearSolve]:
        """Take Newton's step with the exact Jacobian of `K - K_target`.

        The Jacobian is `H - D + b b^T / 4S` with `D` made of blocks `t/4 [[1, 1], [1, 1]]` per boundary edge,
        `t = l / (R sqrt(1 - x^2))`, `x = l / 2R`, `b` the sums of t at vertices and `S` the sum of t. Constants are in
        its kernel and residuals orthogonal to them, so doubling the rank-one term leaves the solution that keeps R.
        """
        lengths, radius = self._polygon(u)
        t = lengths / (radius * np.sqrt(1 - (lengths / (2 * radius)) ** 2))
        weight = corners.half_cotangents.ravel()
        boundary = np.zeros_like(weight)
        boundary[triangulation.glue < 0] = self._in_slot_order(triangulation, t) / 4
        ridge = MOBIUS_RIDGE * float(np.abs(weight).mean())
        b = (np.bincount(self._tails, t, self._n) + np.bincount(self._heads, t, self._n))[self.free]
        factor = factorise(pattern.matrix(weight - boundary, -weight - boundary, ridge))
        x, y = factor.solve(-residual), factor.solve(b)
        return x - y * (b @ x) / (2 * t.sum() + b @ y), LinearSolve(0, refactored=True)

    def _in_slot_order(self, triangulation: Triangulation, values: np.ndarray) -> np.ndarray:
        """Values per boundary edge, kept in the order of the start, in the order of the present slots."""
        by_tail = np.empty(self._n)
        by_tail[self._tails] = values  # every boundary vertex starts one boundary edge
        return by_tail[triangulation.tails.ravel()[triangulation.glue < 0]]
