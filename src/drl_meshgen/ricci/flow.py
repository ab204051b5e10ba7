"""Discrete surface Ricci flow in its vertex-scaling form: the flat metric in a surface's discrete conformal class.

The metric `l_ij exp((u_i + u_j) / 2)` has curvature K (eq. 2); the flow (eq. 3) is the gradient descent of a convex
energy (eq. 4) that is minimised by Newton's method (eq. 5-6).
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.errors import StageError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci.hessian import Pattern
from drl_meshgen.ricci.target import FreeBoundary, InscribedDisk, LinearSolve, Target
from drl_meshgen.ricci.triangulation import Corners, Triangulation, corners, intrinsic_delaunay, ptolemy_delaunay

USABLE_ERROR = 1e-7
WORST = 50
"""An error shows at most so many vertices (count)."""


@dataclass(frozen=True)
class RicciOptions:
    """How the flat metric is computed."""

    boundary: Literal["free", "disk"] = "free"
    """`free`: u = 0 on every boundary vertex, any number of loops. `disk`: one loop, mapped to a circle."""
    flips: bool = True
    """Flip edges to stay intrinsically Delaunay. Without, the surface's own edges are kept and triangles may break."""
    tolerance: float = 1e-10
    """Largest |K - K_target| at any free vertex, radians; below 1e-7 (the paper's figure)."""
    max_steps: int = 400
    """Newton steps before giving up; a dozen do but where bridges are a few triangles thin."""
    max_change: float = 8.0
    """Largest change of u in one step, units of log scale."""
    max_halvings: int = 12
    """Halvings of one step before giving up."""

    def __post_init__(self) -> None:
        if self.boundary not in ("free", "disk"):
            raise ValueError(f"boundary must be 'free' or 'disk', not {self.boundary!r}")
        if not 0 < self.tolerance < USABLE_ERROR:
            raise ValueError(f"tolerance must lie between 0 and {USABLE_ERROR}, not {self.tolerance}")


class Outcome(Enum):
    """Verdict of the flow, as a message for the user."""

    CONVERGED = "converged to the tolerance"
    COARSE = "stopped above the tolerance but below 1e-7: usable"
    BROKEN = "converged, but some triangles break the triangle inequality in the flat metric; remesh the surface"
    STALLED = "no step lowers the curvature error; remesh the surface"
    MAX_STEPS = "the limit of Newton steps was reached; raise max_steps or remesh the surface"
    NOT_FINITE = "the metric overflowed; the surface has triangles too thin for double precision"
    CLOSED = "the surface has no boundary: cut it open first"
    NOT_A_DISK = "the disk target needs a surface of genus 0 with one boundary loop: use the free boundary"


@dataclass(frozen=True, eq=False)
class FlatTriangulation:
    """Triangles of the flat metric, glued along slots (slot `3 f + k` is the side opposite corner `k` of face `f`).

    Vertices are those of the surface, edges may differ from its edges. `lengths[f, k]` is the length of slot
    `3 f + k` in the units of the surface; `glue[s]` the slot on the other side, -1 at the boundary.
    """

    faces: Int[np.ndarray, "f 3"]
    lengths: Float[np.ndarray, "f 3"]
    glue: Int[np.ndarray, " 3f"]


@dataclass(frozen=True, eq=False)
class RicciResult:
    """The flat metric of a surface, and how it was found."""

    u: Float[np.ndarray, " v"]
    """Log conformal factor per vertex."""
    curvature: Float[np.ndarray, " v"]
    """Curvature of the flat metric per vertex, eq. 2, radians; 0 at vertices without a triangle."""
    target: Float[np.ndarray, " v"]
    """Curvature asked for; on a free boundary the curvature that came out."""
    distortion: Float[np.ndarray, " v"]
    """Mean edge stretch of eq. 7-8 on the surface's own edges, relative to the largest stretch."""
    triangulation: FlatTriangulation
    """The triangulation that is Delaunay in the flat metric."""
    history: pd.DataFrame
    """One row per Newton step: step, error, step_length, cg_iterations, flips, refactored, broken, total_curvature."""
    outcome: Outcome
    """Verdict."""
    surface: TriMesh
    """The surface that all of this is about."""

    @property
    def error(self) -> float:
        """Largest |K - K_target|, radians."""
        return float(np.abs(self.curvature - self.target).max())

    def worst(self, count: int) -> Int[np.ndarray, " n"]:
        """Return the vertices with the largest error, at most `count`; one that is not a number is the largest."""
        error = np.nan_to_num(np.abs(self.curvature - self.target), nan=np.inf)
        order = np.argsort(-error, kind="stable")[:count]
        return order[error[order] > 0]

    @property
    def usable(self) -> bool:
        """Whether later stages can build on the metric."""
        return self.outcome in (Outcome.CONVERGED, Outcome.COARSE)


@dataclass(frozen=True, eq=False)
class _State:
    """Everything that belongs to one value of u."""

    u: np.ndarray
    triangulation: Triangulation
    corners: Corners
    curvature: np.ndarray
    residual: np.ndarray
    flips: int

    @property
    def error(self) -> float:
        """Largest residual; infinite where it is not a number."""
        worst = float(np.abs(self.residual).max(initial=0.0))
        return worst if np.isfinite(worst) else np.inf

    @property
    def broken(self) -> int:
        """Number of triangles that break the triangle inequality."""
        return int(self.corners.broken.sum())


def solve(surface: TriMesh, options: RicciOptions | None = None, *, throw: bool = True) -> RicciResult:
    """Find the flat metric of `surface` in its discrete conformal class.

    Intrinsic Delaunay flips at u = 0, then Newton's method with Ptolemy flips. Where this breaks down, fixed
    connectivity with the convex extension is the fallback, and broken triangles are reported.

    Raises `ValueError` for edges without length, `StageError` for a closed surface and for a disk target that does not
    fit, and, unless `throw=False`, `StageError` when no usable metric was found.
    """
    options = options or RicciOptions()
    topology = surface.topology
    if not len(topology.boundary_edges):
        raise StageError("ricci", Outcome.CLOSED)
    if options.boundary == "disk" and (topology.euler != 1 or len(topology.loops) != 1):
        raise StageError("ricci", Outcome.NOT_A_DISK, f"{len(topology.loops)} loops, Euler number {topology.euler}")
    result = _newton(surface, options)
    if options.flips and not result.usable:
        fallback = _newton(surface, replace(options, flips=False))
        result = min(result, fallback, key=lambda r: (not r.usable, np.nan_to_num(r.error, nan=np.inf)))
    if throw and not result.usable:
        broken = int(result.history["broken"].iloc[-1])
        detail = f"curvature error {result.error:.1e}, {broken} broken triangles"
        raise StageError("ricci", result.outcome, detail, where=surface.vertices[result.worst(WORST)])
    return result


def distortion(surface: TriMesh, u: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
    """Discrete vertex distortion of eq. 7-8: mean over a vertex's edges of their stretch, relative to the largest.

    The stretch of an edge is `exp((u_i + u_j) / 2)`; `max` in eq. 8 is over all edges, so values compare across
    vertices and lie in (0, 1]. NaN at vertices without an edge.
    """
    edges = surface.topology.edges
    log_stretch = u[edges].mean(axis=1)
    stretch = np.repeat(np.exp(log_stretch - log_stretch.max()), 2)
    total = np.bincount(edges.ravel(), stretch, len(u))
    valence = surface.topology.valence
    return np.divide(total, valence, out=np.full(len(u), np.nan), where=valence > 0)


def vertex_curvature(
    surface: TriMesh, faces: Int[np.ndarray, "f 3"], angles: Float[np.ndarray, "f 3"]
) -> Float[np.ndarray, " v"]:
    """Angle defect per vertex, eq. 2, radians; 0 at vertices without a triangle. Sums to 2 pi times Euler's number."""
    topology = surface.topology
    full = np.where(topology.on_boundary, np.pi, 2 * np.pi)
    return np.where(topology.used, full - np.bincount(faces.ravel(), angles.ravel(), len(full)), 0.0)


def _evaluate(
    surface: TriMesh, triangulation: Triangulation, u: np.ndarray, target: Target, options: RicciOptions
) -> _State:
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a step too far is told by its error
        triangulation, flips = ptolemy_delaunay(triangulation, u) if options.flips else (triangulation, 0)
        at = corners(triangulation.scaled(u))
        curvature = vertex_curvature(surface, triangulation.faces, at.angles)
        residual = curvature[target.free] - target.curvature(triangulation, u)
    return _State(u, triangulation, at, curvature, residual, flips)


def _line_search(
    surface: TriMesh, state: _State, du: np.ndarray, target: Target, options: RicciOptions
) -> tuple[_State | None, float]:
    """Step that overshoots the minimum along `du` by at most a tenth of the slope, or halves the error."""
    largest = float(np.abs(du).max(initial=0.0))
    if not np.isfinite(largest):
        return None, 0.0
    length = min(1.0, options.max_change / max(largest, options.max_change))
    slope = abs(float(state.residual @ du))
    flips, triangulation = 0, state.triangulation
    for _ in range(options.max_halvings + 1):
        u = state.u.copy()
        u[target.free] += length * du
        trial = _evaluate(surface, triangulation, u, target, options)
        flips, triangulation = flips + trial.flips, trial.triangulation
        allowed = np.isfinite(trial.error) and (target.convex or trial.broken <= state.broken)
        if allowed and (float(trial.residual @ du) <= 0.1 * slope or trial.error <= 0.5 * state.error):
            return replace(trial, flips=flips), length
        length /= 2
    return None, 0.0


def _newton(surface: TriMesh, options: RicciOptions) -> RicciResult:
    topology, n = surface.topology, len(surface.vertices)
    triangulation, flips = Triangulation.of(surface), 0
    if options.flips:
        triangulation, flips = intrinsic_delaunay(triangulation)
    target: Target = (
        FreeBoundary(np.nonzero(topology.used & ~topology.on_boundary)[0])
        if options.boundary == "free"
        else InscribedDisk(np.nonzero(topology.used)[0], triangulation, n)
    )
    state = _evaluate(surface, triangulation, np.zeros(n), target, options)
    history = [_row(0, state, 0.0, LinearSolve(0, refactored=False), flips + state.flips)]
    pattern: Pattern | None = None
    outcome = Outcome.MAX_STEPS
    for step in range(1, options.max_steps + 1):
        if state.error <= options.tolerance or not np.isfinite(state.error):
            break
        if pattern is None or state.flips:
            pattern = Pattern.of(state.triangulation, target.free, n)
        du, cost = target.step(pattern, state.triangulation, state.corners, state.u, state.residual)
        accepted, length = _line_search(surface, state, du, target, options)
        if accepted is None:
            outcome = Outcome.STALLED
            break
        state = accepted
        history.append(_row(step, state, length, cost, state.flips))
    return _result(surface, state, target, history, _verdict(state, options, outcome))


def _verdict(state: _State, options: RicciOptions, otherwise: Outcome) -> Outcome:
    if not np.isfinite(state.error):
        return Outcome.NOT_FINITE
    if state.error >= USABLE_ERROR:
        return otherwise
    if state.broken:
        return Outcome.BROKEN
    return Outcome.CONVERGED if state.error <= options.tolerance else Outcome.COARSE


def _row(step: int, state: _State, length: float, cost: LinearSolve, flips: int) -> dict[str, float | int | bool]:
    return {
        "step": step,
        "error": state.error,
        "step_length": length,
        "cg_iterations": cost.iterations,
        "flips": flips,
        "refactored": cost.refactored,
        "broken": state.broken,
        "total_curvature": float(state.curvature.sum()),
    }


def _result(
    surface: TriMesh, state: _State, target: Target, history: list[dict[str, float | int | bool]], outcome: Outcome
) -> RicciResult:
    goal = state.curvature.copy()
    goal[target.free] = target.curvature(state.triangulation, state.u)
    t = state.triangulation
    flat = FlatTriangulation(t.faces, np.exp(t.scaled(state.u)), t.glue)
    return RicciResult(
        state.u, state.curvature, goal, distortion(surface, state.u), flat, pd.DataFrame(history), outcome, surface
    )
