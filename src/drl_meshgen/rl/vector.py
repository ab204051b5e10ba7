"""Many episodes of `OTypeEnvironment` side by side: the same decisions, masks, observations and rewards, as arrays."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.rl.environment import (
    CORNERS,
    LAYERS,
    STEPS,
    EnvironmentOptions,
    checked,
    inside,
    position_grid,
    quarters,
)
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.templates.curves import LINE_TYPES
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import OParameters

CHOSEN = STEPS + 5
"""Numbers that say what was decided so far."""

State = dict[str, np.ndarray]
"""What there is to know of `b` episodes, little enough to be kept in a replay buffer; leading axis b."""
Observation = dict[str, np.ndarray]
"""What a network sees of them; leading axis b."""


class VectorEnvironment:
    """`count` episodes side by side, each in a domain of its own; over are those at step `STEPS`.

    A state holds `domain (b,)`, `step (b,)` and `chosen (b, CHOSEN)`; `observation` turns it into what
    `OTypeEnvironment` gives. Unlike there, an action that the mask forbids is an error.
    """

    def __init__(self, domains: Sequence[Domain], count: int, options: EnvironmentOptions | None = None) -> None:
        """Take the domains; raises `InputError` where one is odd, too large or none is there."""
        self.options = options or EnvironmentOptions()
        self.domains = checked(domains, self.options)
        self.count = count
        n = self.options.positions
        self._sizes = np.array([len(domain) for domain in self.domains])
        self._nodes = [domain.frame.to_local(domain.nodes) for domain in self.domains]
        self._boundary = np.zeros((len(self.domains), self.options.most_nodes, 2), np.float32)
        for row, nodes in zip(self._boundary, self._nodes, strict=True):
            row[: len(nodes)] = nodes
        self._quarters = quarters(n).reshape(4, -1)
        self._domain = np.zeros(count, np.int64)
        self._at = np.full(count, STEPS)
        self._actions = np.zeros((count, STEPS), np.int64)
        self._chosen = np.zeros((count, CHOSEN), np.float32)
        self._grid = np.zeros((count, n * n, 2))
        self._allowed = np.zeros((count, 4, n * n), bool)
        self._singular = np.zeros((count, 4, 2))
        self.reward = np.zeros(count)
        """Reward of the mesh of each episode that is over, without penalty."""
        self.valid = np.zeros(count, bool)
        """Whether that mesh is valid."""

    @property
    def actions(self) -> int:
        """Size of the shared action space."""
        return self.options.actions

    def begin(self, which: Bool[np.ndarray, " n"], domains: Int[np.ndarray, " k"]) -> None:
        """Begin the episodes `which` anew, in the domains of these numbers."""
        self._domain[which] = domains
        self._at[which] = 0
        self._actions[which] = 0
        self._chosen[which] = 0

    @property
    def over(self) -> Bool[np.ndarray, " n"]:
        """Which episodes are over."""
        return self._at == STEPS

    def state(self) -> State:
        """Return the state of all episodes."""
        return {"domain": self._domain.copy(), "step": self._at.copy(), "chosen": self._chosen.copy()}

    def observation(self, state: State) -> Observation:
        """Return what networks see of `b` states, as `OTypeEnvironment` has it."""
        step = np.zeros((len(state["step"]), STEPS), np.float32)
        step[np.arange(len(step)), np.minimum(state["step"], STEPS - 1)] = 1
        count = self._sizes[state["domain"], None].astype(np.float32)
        return {"boundary": self._boundary[state["domain"]], "count": count, "step": step, "chosen": state["chosen"]}

    def masks(self) -> Bool[np.ndarray, "n a"]:
        """Return which actions count for each episode; all where it is over."""
        half, at = self._sizes[self._domain] // 2, self._at
        placing = (at > CORNERS) & (at < LAYERS)
        lowest, most = self.options.layers
        size = np.select(
            [at == CORNERS, placing, at == LAYERS, at < STEPS],
            [half * (half - 1), self._quarters.shape[1], most - lowest + 1, len(LINE_TYPES)],
            self.actions,
        )
        mask = np.arange(self.actions) < size[:, None]
        mask[placing, : self._quarters.shape[1]] = self._allowed[placing, at[placing] - CORNERS - 1]
        return mask

    def step(self, actions: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Decide the next parameter of every episode; return what each gained and whether it is over now.

        Raises `InputError` for an action that the mask forbids, and where an episode is over already.
        """
        rows = np.arange(self.count)
        wrong = np.nonzero(self.over | ~self.masks()[rows, actions])[0]
        if len(wrong):
            i = wrong[0]
            raise InputError("environment", f"action {actions[i]} of episode {i} does not count at step {self._at[i]}")
        at, half = self._at.copy(), self._sizes[self._domain] // 2
        self._actions[rows, at] = actions
        self._at += 1
        self._cornered(rows[at == CORNERS])
        placed = rows[(at > CORNERS) & (at < LAYERS)]
        self._singular[placed, at[placed] - 1] = self._grid[placed, actions[placed]]
        self._chosen[placed, 2 * at[placed]] = self._singular[placed, at[placed] - 1, 0]
        self._chosen[placed, 2 * at[placed] + 1] = self._singular[placed, at[placed] - 1, 1]
        layered = rows[at == LAYERS]
        self._chosen[layered, 10] = (self.options.layers[0] + actions[layered]) / self.options.layers[1]
        lined = rows[at > LAYERS]
        self._chosen[lined, at[lined] + 5] = actions[lined] / len(LINE_TYPES)
        first = rows[at == CORNERS]
        self._chosen[first, :2] = self._corners(first) / (2 * half[first, None])
        gained, done = np.zeros(self.count), self.over
        for i in rows[done]:
            gained[i] = self._judged(i)
        return gained, done

    def _corners(self, rows: Int[np.ndarray, " k"]) -> Int[np.ndarray, "k 2"]:
        i0, m = np.divmod(self._actions[rows, CORNERS], self._sizes[self._domain[rows]] // 2 - 1)
        return np.stack([i0, m + 1], axis=-1)

    def _cornered(self, rows: Int[np.ndarray, " k"]) -> None:
        """Lay the grids of positions for singular points."""
        n = self.options.positions
        for i, (i0, m) in zip(rows, self._corners(rows).tolist(), strict=True):
            nodes = self._nodes[self._domain[i]]
            grid = position_grid(nodes, (i0, m), n)
            near = self._quarters & inside(nodes, grid).ravel()
            self._grid[i] = grid.reshape(-1, 2)
            self._allowed[i] = np.where(near.any(axis=1, keepdims=True), near, self._quarters)

    def _judged(self, i: int) -> float:
        nodes, corners = self._nodes[self._domain[i]], self._corners(np.array([i]))
        layers = self.options.layers[0] + self._actions[i, LAYERS, None]
        bulges = LINE_TYPES[self._actions[i, None, LAYERS + 1 :]]
        judged = judge_o(nodes, corners, layers, self._singular[i, None], bulges, self.options.weights)
        self.reward[i], self.valid[i] = judged.reward[0], judged.valid[0]
        return float(judged.reward[0] - (judged.penalty[0] if self.options.penalised else 0.0))

    def parameters(self, i: int) -> OParameters:
        """Return what episode `i` decided, in the plane of its domain; raises `InputError` before its end."""
        if not self.over[i]:
            raise InputError("environment", f"{self._at[i]} of {STEPS} decisions were made", "finish the episode")
        domain = self.domains[self._domain[i]]
        i0, m = self._corners(np.array([i]))[0].tolist()
        layers = self.options.layers[0] + int(self._actions[i, LAYERS])
        bulges = LINE_TYPES[self._actions[i, LAYERS + 1 :]]
        return OParameters(i0, m, len(domain) // 2 - m, layers, domain.frame.to_world(self._singular[i]), bulges)
