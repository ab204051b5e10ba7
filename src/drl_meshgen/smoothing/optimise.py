"""The node optimiser: relax, minimise, sharpen, repair; keep the best mesh seen."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.smoothing.energy import QuadEnergy, Residuals, ideal_angles
from drl_meshgen.smoothing.newton import minimise
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState
from drl_meshgen.smoothing.options import SmoothingOptions, SmoothingOutcome, SmoothingResult
from drl_meshgen.smoothing.relax import sweep
from drl_meshgen.smoothing.untangle import untangle
from drl_meshgen.smoothing.verdict import Figures, figures, shape_on_surface


class _Best:
    """Best state so far and the record of how it was reached."""

    def __init__(self, space: NodeSpace, energy: QuadEnergy, options: SmoothingOptions) -> None:
        self.space, self.energy, self.options = space, energy, options
        self.rows: list[dict] = []
        self.state: NodeState | None = None
        self.score = np.inf

    def judge(self, stage: str, state: NodeState, cost: float = np.nan, damping: float = np.nan) -> Figures:
        """Record a state and keep it if it is the best."""
        found = figures(self.energy.shape(state), self.energy.pairs)
        score = found.shortfall(self.options)
        if score < self.score:
            self.state, self.score = state, score
        self.rows.append({"stage": stage, "cost": cost, "damping": damping, **vars(found)})
        return found


def reach_of(mesh: QuadMesh, points: Float[np.ndarray, "n 3"], share: float) -> Float[np.ndarray, " n"]:
    """Longest step of each node: a share of the mean length of its edges, averaged with that of all edges."""
    edges = mesh.topology.edges
    length = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    total = np.bincount(edges.ravel(), np.repeat(length, 2), minlength=len(points))
    local = total / np.maximum(mesh.topology.valence, 1)
    return 0.5 * share * (local + length.mean())


class Patch(NamedTuple):
    """Quads around bad ones and the nodes that move to mend them."""

    energy: QuadEnergy
    moving: Bool[np.ndarray, " n"]


def patch_around(mesh: QuadMesh, bad: Bool[np.ndarray, " m"], rings: int, whole: QuadEnergy) -> Patch:
    """Nodes within `rings` quads of the bad ones, and all quads at those nodes."""
    quads = mesh.quads
    chosen = bad
    moving = np.zeros(len(mesh.points), bool)
    for _ in range(rings):
        moving[quads[chosen].ravel()] = True
        chosen = moving[quads].any(axis=1)
    return Patch(QuadEnergy(mesh, whole.options, np.nonzero(chosen)[0], whole.ideal), moving)


def unfold(space: NodeSpace, whole: QuadEnergy, state: NodeState, options: SmoothingOptions) -> NodeState:
    """Untangle around folded quads, in patches that grow from round to round."""
    mesh = space.mesh
    for round_ in range(options.unfold_rounds):
        folded = ~whole.shape(state).valid
        if not folded.any():
            break
        patch = patch_around(mesh, folded, options.repair_rings + 2 * round_, whole)
        reach = reach_of(mesh, state.points, 2 * options.step_limit)
        state = space.thaw(untangle(space, patch.energy, space.freeze(state, patch.moving), reach))
    return state


def optimise(
    surface: TriMesh,
    mesh: QuadMesh,
    triangle: Int[np.ndarray, " n"],
    options: SmoothingOptions | None = None,
    fixed: Bool[np.ndarray, " n"] | None = None,
) -> SmoothingResult:
    """Move the nodes of `mesh` over `surface` until its quads are well shaped; connectivity stays.

    `triangle[k]` is the surface triangle that node `k` starts in. Nodes on the mesh's boundary slide along the
    surface's boundary, all others move tangentially and walk from triangle to triangle; `fixed` ones stay.
    The start may hold folded quads. Deterministic. Raises `InputError` if the boundary loops do not match.
    """
    options = options or SmoothingOptions()
    space = NodeSpace(surface, mesh, fixed)
    ideal = ideal_angles(mesh)
    energy = QuadEnergy(mesh, options, ideal=ideal)
    state = space.start(triangle)
    best = _Best(space, energy, options)
    best.judge("start", state)
    for _ in range(options.relax_sweeps):
        state = sweep(space, energy, state, reach_of(mesh, state.points, options.step_limit))
    best.judge("relax", state)
    state = unfold(space, energy, state, options)
    best.judge("unfold", state)
    for k, (hinge, steps) in enumerate(zip(options.hinge_weights, options.newton_steps, strict=True)):
        def observe(s: NodeState, _r: Residuals, cost: float, damping: float, stage: str = f"newton {k + 1}") -> None:
            best.judge(stage, s, cost, damping)

        reach = reach_of(mesh, state.points, options.step_limit)
        state = minimise(space, energy.with_hinge(hinge), state, reach, steps, observe)
        state = unfold(space, energy, state, options)
        best.judge(f"unfold {k + 1}", state)
    for round_ in range(options.repair_rounds):
        state = unfold(space, energy, best.state, options)
        best.judge("unfold", state)
        angle = np.degrees(energy.shape(state).angle)
        low, high = options.repair_angles
        bad = ((angle < low) | (angle > high)).any(axis=0)
        if not bad.any():
            break
        patch = patch_around(mesh, bad, options.repair_rings + round_, energy)

        def keep(s: NodeState, _r: Residuals, cost: float, damping: float, stage: str = f"repair {round_ + 1}") -> None:
            best.judge(stage, s, cost, damping)

        reach = reach_of(mesh, state.points, options.step_limit)
        local = patch.energy.with_hinge(options.repair_hinge)
        minimise(space, local, space.freeze(state, patch.moving), reach, options.repair_steps, keep)
    state = best.state
    final = figures(shape_on_surface(surface, mesh, state.points), energy.pairs)
    low, high = options.wanted_angles
    if final.invalid:
        outcome = SmoothingOutcome.INVALID
    elif final.min_angle < low or final.max_angle > high:
        outcome = SmoothingOutcome.VALID
    else:
        outcome = SmoothingOutcome.GOOD
    return SmoothingResult(state.points, state.triangle, outcome, pd.DataFrame(best.rows))
