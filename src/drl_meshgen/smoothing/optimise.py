"""The node optimiser: relax, minimise, sharpen, repair; keep the best mesh seen."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import FeatureCurve, QuadMesh, TriMesh
from drl_meshgen.progress import counter
from drl_meshgen.smoothing.energy import QuadEnergy, Residuals, ideal_angles
from drl_meshgen.smoothing.newton import Observer, minimise
from drl_meshgen.smoothing.nodes import Chain, NodeSpace, NodeState
from drl_meshgen.smoothing.options import SmoothingOptions, SmoothingOutcome, SmoothingResult
from drl_meshgen.smoothing.patches import reach_of, repair, unfold
from drl_meshgen.smoothing.relax import sweep
from drl_meshgen.smoothing.restart import settled
from drl_meshgen.smoothing.search import search, search_all
from drl_meshgen.smoothing.settle import settle
from drl_meshgen.smoothing.verdict import Figures, Referee


class _Record:
    """Best state so far and the record of how it was reached."""

    def __init__(self, referee: Referee, state: NodeState) -> None:
        self.referee, self.state = referee, state
        self.rows: list[dict] = []
        self.score, self.exact = np.inf, False
        self.best = self.judge("start", state)

    def judge(self, stage: str, state: NodeState, cost: float = np.nan, damping: float = np.nan) -> Figures:
        """Record a state and keep it if it is the best."""
        found = self.referee.figures(state, exact=self.exact)
        score = found.shortfall(self.referee.options)
        if score < self.score:
            self.state, self.score, self.best = state, score, found
        self.rows.append({"stage": stage, "cost": cost, "damping": damping, **vars(found)})
        return found

    def look_closely(self) -> None:
        """From now on judge orientation exactly, the best state included."""
        self.exact = True
        self.best = self.referee.figures(self.state, exact=True)
        self.score = self.best.shortfall(self.referee.options)

    def restart(self, stage: str, state: NodeState) -> Figures:
        """Record a state that is to be the best so far."""
        self.score = np.inf
        return self.judge(stage, state)

    def observer(self, stage: str) -> Observer:
        """Return what to call after every step of a stage."""

        def observe(state: NodeState, _residuals: Residuals, cost: float, damping: float) -> None:
            self.judge(stage, state, cost, damping)

        return observe


def optimise(
    surface: TriMesh,
    mesh: QuadMesh,
    triangle: Int[np.ndarray, " n"],
    options: SmoothingOptions | None = None,
    fixed: Bool[np.ndarray, " n"] | None = None,
    *,
    sizes: Float[np.ndarray, " v"] | None = None,
    features: Sequence[FeatureCurve] = (),
    chains: Sequence[Chain] = (),
) -> SmoothingResult:
    """Move the nodes of `mesh` over `surface` until its quads are well shaped; connectivity stays.

    `triangle[k]` is the surface triangle that node `k` starts in. Nodes on the mesh's boundary slide along the
    surface's boundary, all others move tangentially and walk from triangle to triangle; `fixed` ones stay.
    `sizes` are wanted edge lengths at the vertices of the surface, of which only the ratios count. The nodes of
    `chains` are put on curves of `features` and slide along them (see `optimise_along`).
    The start may hold folded quads. Deterministic. Raises `InputError` if the boundary loops do not match.
    """
    options = options or SmoothingOptions()
    limits = np.radians(options.wanted_angles)
    turn = np.radians(options.corner_turn)
    space = NodeSpace(
        surface,
        mesh,
        fixed,
        features=features,
        chains=chains,
        corner_turn=turn,
        corner_limits=(limits[0], limits[1]),
    )
    wanted = None if sizes is None else sizes[surface.triangles]
    energy = QuadEnergy(mesh, options, ideal=ideal_angles(mesh), sizes=wanted)
    referee = Referee(surface, mesh, options, wanted)
    state = space.start(triangle)
    record = _Record(referee, state)
    advance = counter("phases of the node optimiser done", len(options.newton_steps) + options.repair_rounds + 2)
    state = settled(space, state)
    for _ in range(options.relax_sweeps):
        state = sweep(space, energy, state, reach_of(mesh, state.points, options.step_limit))
    record.judge("relax", state)
    idle = np.zeros(len(mesh.quads), np.int64)
    state = unfold(space, energy, referee, state, idle)
    record.judge("unfold", state)
    advance()
    for k, (hinge, steps) in enumerate(zip(options.hinge_weights, options.newton_steps, strict=True)):
        stage = f"newton {k + 1}"
        reach = reach_of(mesh, state.points, options.step_limit)
        state = minimise(space, energy.with_hinge(hinge), state, reach, steps=steps, observe=record.observer(stage))
        if record.rows[-1]["invalid"]:
            state = unfold(space, energy, referee, state, idle)
            record.judge(f"unfold {k + 1}", state)
        advance()
    unfinished = state
    if record.rows[-1]["invalid"] and options.searches:
        unfinished = search(space, referee, state)
        record.judge("search", unfinished)
    record.look_closely()
    left = np.inf
    for k in range(options.repair_rounds):
        # a search goes on from where the one before led only if repair has undone some of the folds it left
        if 0 < record.best.invalid < left and k < options.searches:
            left = record.restart("search", search_all(space, energy, referee, (record.state, unfinished))).invalid
        state = record.state
        if not referee.bad(state).any():
            break
        # what did not help in small surroundings may in larger ones
        record.judge(f"repair {k + 1}", repair(space, energy, referee, state, options.repair_rings + k))
        advance()
    if options.settle_rounds and not record.best.invalid:
        record.restart("settle", settle(space, energy, referee, record.state))
    state, final = record.state, record.best
    low, high = options.wanted_angles
    if final.invalid:
        outcome = SmoothingOutcome.INVALID
    elif final.min_angle < low or final.max_angle > high:
        outcome = SmoothingOutcome.VALID
    else:
        outcome = SmoothingOutcome.GOOD
    return SmoothingResult(state.points, state.triangle, outcome, pd.DataFrame(record.rows))
