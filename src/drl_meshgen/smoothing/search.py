"""Last resort for folded quads where the surface is too sharp for derivatives: try places, node by node."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from drl_meshgen.smoothing.energy import QuadEnergy
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState
from drl_meshgen.smoothing.patches import AVERAGING, patch_around
from drl_meshgen.smoothing.restart import averaged
from drl_meshgen.smoothing.verdict import Referee

DIRECTIONS = 10
RADII = (1.0, 0.5, 0.25, 0.1)
"""Distances tried, in mean lengths of the edges at the nodes."""
SHRINKING = (0.3, 0.6)
"""Shares of the way to one of its corners that a whole quad is tried to be drawn together."""
AVERAGED_RINGS = (1, 2, 3, 4)
"""Rings of quads around folded ones whose nodes are averaged with their neighbours to search on from there."""
SWEEPS = 10
"""Most sweeps over the nodes around folded quads."""
SIZES = 3
"""Sizes of surroundings that sweeps take turns with, from the nodes of folded quads to two rings around them."""
PATIENCE = 6
"""A search ends after this many sweeps in a row that left no fewer quads folded."""


class _Board:
    """Places of all nodes, one group of nodes moved at a time."""

    def __init__(self, space: NodeSpace, referee: Referee, state: NodeState) -> None:
        self.space, self.referee, self.tangents = space, referee, state.tangents
        self.triangle, self.weights = state.triangle.copy(), state.weights.copy()
        self.points = state.points.copy()
        quads = space.mesh.quads
        order = np.argsort(quads.ravel(), kind="stable")
        self._member = order // 4
        self._start = np.r_[0, np.cumsum(np.bincount(quads.ravel(), minlength=len(self.points)))]
        self._slot = np.full(len(self.points), -1)

    def improve(self, group: Int[np.ndarray, " k"], turn: float) -> None:
        """Move a group of nodes to the best of the places around; `turn` rotates the pattern (radians)."""
        at = [self._member[self._start[v] : self._start[v + 1]] for v in group]
        ring = self.space.mesh.quads[np.unique(np.concatenate(at))]
        scale = np.linalg.norm(self.points[ring] - self.points[np.roll(ring, 1, axis=1)], axis=2).mean()
        angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS + turn
        circle = (
            np.cos(angle)[:, None] * self.tangents[0, group[0]] + np.sin(angle)[:, None] * self.tangents[1, group[0]]
        )
        shifts = np.concatenate([np.zeros((1, 3)), *(r * scale * circle for r in RADII)])
        moves = np.repeat(shifts[:, None], len(group), axis=1)
        if len(group) > 1:
            towards = self.points[group][:, None] - self.points[group][None]
            moves = np.concatenate([moves, *(share * towards for share in SHRINKING)])
        many = (len(moves), 1)
        walker = self.space.walker
        found, weights = walker.walk(
            np.tile(self.triangle[group], len(moves)), np.tile(self.weights[group], many), moves.reshape(-1, 3)
        )
        places = walker.positions(found, weights).reshape(moves.shape)
        self._slot[group] = np.arange(len(group))
        slot = self._slot[ring]
        corners = np.where((slot >= 0)[None, :, :, None], places[:, slot], self.points[ring][None])
        self._slot[group] = -1
        best = self.referee.best_of_places(corners)
        self.triangle[group] = found.reshape(many[0], -1)[best]
        self.weights[group] = weights.reshape(moves.shape)[best]
        self.points[group] = places[best]

    def state(self, state: NodeState) -> NodeState:
        """Return the state with the nodes where they have been moved to."""
        return self.space.thaw(replace(state, triangle=self.triangle, weights=self.weights))


def search(space: NodeSpace, referee: Referee, state: NodeState, *, whole_quads: bool = False) -> NodeState:
    """Return a state with fewer folded quads: each inner node near one goes to the best place around.

    A place is judged by the sum of the squared penalties of the quads at the nodes (exact orientation). With
    `whole_quads` folded quads are moved and shrunk as a whole as well, which gets other knots undone.
    """
    mesh, free = space.mesh, space.free
    best, fewest, idle = state, np.inf, 0
    for sweep in range(SWEEPS + 1):
        folded = ~referee.shape(state, exact=True).valid
        count = int(folded.sum())
        idle = 0 if count < fewest else idle + 1
        if count <= fewest:
            best, fewest = state, count
        if not count or idle == PATIENCE or sweep == SWEEPS:
            break
        near = np.zeros(len(mesh.points), bool)
        near[mesh.quads[folded]] = True
        for _ in range(sweep % SIZES):
            near[mesh.quads[near[mesh.quads].any(axis=1)]] = True
        board = _Board(space, referee, state)
        if whole_quads:
            for quad in mesh.quads[folded & free[mesh.quads].all(axis=1)]:
                board.improve(quad, float(sweep))
        for node in np.nonzero(near & free)[0]:
            board.improve(np.array([node]), float(sweep))
        state = board.state(state)
    return best


def search_all(space: NodeSpace, whole: QuadEnergy, referee: Referee, states: tuple[NodeState, ...]) -> NodeState:
    """Search from several states until nothing is folded, then on from the best, with whole quads; return the best.

    Where folds are left, the nodes around them are brought to the middle of their neighbours, ring by ring, and
    searched from there: a knot comes undone from another start rather than by more of the same search.
    """

    def folded(state: NodeState) -> Bool[np.ndarray, " m"]:
        return ~referee.shape(state, exact=True).valid

    best, fewest = states[0], np.inf
    different = [state for k, state in enumerate(states) if not any(state is other for other in states[:k])]
    for state in different:
        found = search(space, referee, state, whole_quads=True)
        count = folded(found).sum()
        if count < fewest:
            best, fewest = found, count
        if not fewest:
            return best
    for rings in AVERAGED_RINGS:
        patch = patch_around(space.mesh, folded(best), rings, whole)
        start = averaged(space, space.freeze(best, patch.moving), AVERAGING * rings)
        found = search(space, referee, space.thaw(start), whole_quads=True)
        count = folded(found).sum()
        if count < fewest:
            best, fewest = found, count
        if not fewest:
            break
    return best
