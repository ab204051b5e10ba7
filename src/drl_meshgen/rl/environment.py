"""The paper's staged decision process (section 5.2) for O-type templates, as a gymnasium environment.

Fourteen decisions: the pair of corners `(i0, m)`, the four singular points on a grid, the number of layers, a line
type for each of eight internal edges. All share one action space; `action_masks` says which actions count at a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.templates.curves import LINE_TYPES
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.o_type import EDGES, OParameters, instantiate
from drl_meshgen.templates.score import Weights, reward, validity_penalty
from drl_meshgen.templates.tfi import arc_fractions, transfinite

CORNERS: Final = 0
"""Step at which the corners are chosen; the singular points follow."""
LAYERS: Final = 5
"""Step at which the number of layers is chosen; the line types follow."""
STEPS: Final = LAYERS + 1 + EDGES
INVALID_ACTION: Final = -1.0
"""Reward of an action that the mask forbids; it ends the episode."""


@dataclass(frozen=True)
class EnvironmentOptions:
    """Size of the action space, and the reward."""

    most_nodes: int = 120
    """Boundary nodes of the largest domain (count)."""
    positions: int = 20
    """Candidate positions N of a singular point in either direction (count)."""
    layers: tuple[int, int] = (3, 10)
    """Fewest and most radial layers."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward."""
    penalised: bool = True
    """Whether cells near folding are penalised on top of the paper's reward."""

    @property
    def actions(self) -> int:
        """Size of the shared action space: the largest of those of the single steps."""
        half = self.most_nodes // 2
        return max(half * (half - 1), self.positions**2, self.layers[1] - self.layers[0] + 1, len(LINE_TYPES))


class OTypeEnvironment(gymnasium.Env[Any, np.int64]):
    """One episode places the O-type template in one domain; the reward comes at its end.

    Observation, all float32: `boundary (most_nodes, 2)` the nodes in the domain's frame, zeros after the last; `count`
    their number; `step` one-hot; `chosen` what was decided so far (0 where nothing): i0 / L, m / L, the singular points
    in the frame, k over the most layers, line types over their number.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - gymnasium declares it as an instance's

    def __init__(self, domains: Sequence[Domain], options: EnvironmentOptions | None = None) -> None:
        """Take the domains that episodes draw from; raises `InputError` where one is odd, too large or none there."""
        self.options = options or EnvironmentOptions()
        self.domains = tuple(Domain(domain.frame.to_local(domain.nodes)) for domain in checked(domains, self.options))
        far = float(max(np.abs(domain.nodes).max() for domain in self.domains))
        self.action_space = spaces.Discrete(self.options.actions)
        self.observation_space = spaces.Dict(
            {
                "boundary": spaces.Box(-far, far, (self.options.most_nodes, 2)),
                "count": spaces.Box(0, self.options.most_nodes, (1,)),
                "step": spaces.Box(0, 1, (STEPS,)),
                "chosen": spaces.Box(-2 * far - 1, 2 * far + 1, (STEPS + 5,)),
            }
        )
        self._start(0)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict, dict]:
        """Begin with a random domain, or the one `options["index"]` names."""
        super().reset(seed=seed)
        given = (options or {}).get("index")
        self._start(int(self.np_random.integers(len(self.domains))) if given is None else int(given))
        return self._observation(), {"action_mask": self.action_masks()}

    def _start(self, index: int) -> None:
        self.domain = self.domains[index]
        self._actions: list[int] = []
        self._grid = np.zeros((self.options.positions, self.options.positions, 2))
        self._inside = np.ones((self.options.positions,) * 2, bool)

    def step(self, action: np.int64) -> tuple[dict, float, bool, bool, dict]:
        """Decide the next parameter; the last decision makes the mesh and ends the episode."""
        if not self.action_masks()[action]:
            return self._observation(), INVALID_ACTION, True, False, {"action_mask": self.action_masks()}
        self._actions.append(int(action))
        if len(self._actions) == CORNERS + 1:
            self._grid = position_grid(self.domain.nodes, self._corners, self.options.positions)
            self._inside = inside(self.domain.nodes, self._grid)
        done = len(self._actions) == STEPS
        gained, info = self._result() if done else (0.0, {})
        return self._observation(), gained, done, False, info | {"action_mask": self.action_masks()}

    def _result(self) -> tuple[float, dict[str, Any]]:
        mesh = self.mesh()
        points, quads = np.array(mesh.points), np.array(mesh.quads)
        score = float(reward(points, quads, weights=self.options.weights))
        penalty = float(validity_penalty(points, quads)) if self.options.penalised else 0.0
        return score - penalty, {"reward": score, "valid": mesh.valid}

    def mesh(self) -> TemplateMesh:
        """Return the mesh of a finished episode, in the domain's frame."""
        return instantiate(self.domain, self.parameters())

    def parameters(self) -> OParameters:
        """Return what a finished episode decided; raises `InputError` before its end."""
        if len(self._actions) < STEPS:
            raise InputError(
                "environment", f"{len(self._actions)} of {STEPS} decisions were made", "finish the episode"
            )
        i0, m = self._corners
        layers = self.options.layers[0] + self._actions[LAYERS]
        bulges = LINE_TYPES[self._actions[LAYERS + 1 :]]
        return OParameters(i0, m, len(self.domain) // 2 - m, layers, self._singular, bulges)

    @property
    def _corners(self) -> tuple[int, int]:
        i0, m = divmod(self._actions[CORNERS], len(self.domain) // 2 - 1)
        return i0, m + 1

    @property
    def _singular(self) -> Float[np.ndarray, "s 2"]:
        return self._grid.reshape(-1, 2)[self._actions[CORNERS + 1 : LAYERS]]

    def action_masks(self) -> Bool[np.ndarray, " a"]:
        """Return which actions count at this step; all where the episode is over.

        Corners `(i0, m)` and `(i0 + L / 2, m)` are the same four, so i0 is below L / 2. A singular point lies in the
        quarter of the grid next to its corner and inside the domain, unless all of that quarter is outside.
        """
        mask = np.zeros(self.options.actions, bool)
        at, half = len(self._actions), len(self.domain) // 2
        if at == CORNERS:
            mask[: half * (half - 1)] = True
        elif at < LAYERS:
            quarter = quarters(self.options.positions)[at - CORNERS - 1]
            near = quarter & self._inside
            mask[: quarter.size] = (near if near.any() else quarter).ravel()
        elif at == LAYERS:
            mask[: self.options.layers[1] - self.options.layers[0] + 1] = True
        elif at < STEPS:
            mask[: len(LINE_TYPES)] = True
        else:
            mask[:] = True
        return mask

    def _observation(self) -> dict[str, np.ndarray]:
        at, half = len(self._actions), len(self.domain) // 2
        boundary = np.zeros((self.options.most_nodes, 2), np.float32)
        boundary[: len(self.domain)] = self.domain.nodes
        chosen = np.zeros(STEPS + 5, np.float32)
        if at > CORNERS:
            chosen[:2] = np.array(self._corners) / (2 * half)
            placed = self._singular.ravel()
            chosen[2 : 2 + len(placed)] = placed
        if at > LAYERS:
            chosen[10] = (self.options.layers[0] + self._actions[LAYERS]) / self.options.layers[1]
            lines = np.array(self._actions[LAYERS + 1 :]) / len(LINE_TYPES)
            chosen[11 : 11 + len(lines)] = lines
        step = np.zeros(STEPS, np.float32)
        step[min(at, STEPS - 1)] = 1
        count = np.array([len(self.domain)], np.float32)
        return {"boundary": boundary, "count": count, "step": step, "chosen": chosen}


def checked(domains: Sequence[Domain], options: EnvironmentOptions) -> tuple[Domain, ...]:
    """Return the domains; raises `InputError` where one has an odd number of nodes or too many, or none is there."""
    odd = [len(domain) for domain in domains if len(domain) % 2 or len(domain) > options.most_nodes]
    if odd or not domains:
        what = f"a domain of {odd[0]} nodes" if odd else "no domain"
        raise InputError("environment", what, f"give an even number, at most {options.most_nodes}")
    return tuple(domains)


def position_grid(
    nodes: Float[np.ndarray, "l 2"], corners: tuple[int, int], count: int
) -> Float[np.ndarray, "count count 2"]:
    """Return candidate positions of singular points: a Coons patch of the four sides, `(i, j)` towards corner 1 and 3.

    `corners` is `(i0, m)`. The positions lie at the middles of `count` by `count` cells of the patch.
    """
    i0, m = corners
    n = len(nodes) // 2 - m
    loop = np.roll(nodes, -i0, axis=0)
    loop = np.concatenate([loop, loop[:1]])
    ends = np.cumsum([0, m, n, m, n])
    t = np.concatenate([[0.0], (np.arange(count) + 0.5) / count, [1.0]])
    bottom, right, top, left = (_at(loop[a : b + 1], t) for a, b in pairwise(ends))
    return transfinite(bottom, top[::-1], left[::-1], right, (t, t, t, t))[1:-1, 1:-1]


def _at(curve: Float[np.ndarray, "n 2"], t: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 2"]:
    run = arc_fractions(curve)
    return np.stack([np.interp(t, run, axis) for axis in curve.T], axis=1)


def quarters(count: int) -> Bool[np.ndarray, "4 count count"]:
    """Return the part of the position grid next to each corner."""
    low = np.arange(count) < count / 2
    return np.stack([np.outer(a, b) for a, b in ((low, low), (~low, low), (~low, ~low), (low, ~low))])


def inside(nodes: Float[np.ndarray, "l 2"], points: Float[np.ndarray, "*k 2"]) -> Bool[np.ndarray, "*k"]:
    """Return which points lie inside a polygon: a ray to the right of them crosses it an odd number of times."""
    a, b = nodes, np.roll(nodes, -1, axis=0)
    x, y = points[..., 0, None], points[..., 1, None]
    crossing = (a[:, 1] > y) != (b[:, 1] > y)
    slope = (b[:, 0] - a[:, 0]) / np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
    hits: Int[np.ndarray, "*k"] = (crossing & (x < a[:, 0] + slope * (y - a[:, 1]))).sum(axis=-1)
    return hits % 2 == 1
