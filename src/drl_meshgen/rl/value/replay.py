"""Replay buffer of transitions over one or more steps, drawn evenly or by priority (Schaul et al. 2016)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.rl.vector import State


class Moment(NamedTuple):
    """One step of an episode."""

    state: State
    """Where it was; arrays without leading axis."""
    mask: Bool[np.ndarray, " a"]
    """What it could do."""
    action: int
    """What it did."""
    gained: float
    """What that gave."""


@dataclass(frozen=True, eq=False)
class Transitions:
    """What a learner is told of b moments."""

    state: State
    """Where they were."""
    action: Int[np.ndarray, " b"]
    """What they did."""
    gain: Float[np.ndarray, " b"]
    """Discounted sum of rewards up to the later state."""
    discount: Float[np.ndarray, " b"]
    """What the value of that state counts; 0 where the episode was over."""
    later: State
    """State after one or more steps."""
    mask: Bool[np.ndarray, "b a"]
    """Actions that count there; none where the episode was over."""


def transitions(episode: Sequence[Moment], horizon: int, discount: float) -> list[dict[str, np.ndarray]]:
    """Return one row per moment of a finished episode, each looking `horizon` steps ahead or to the end."""
    rows = []
    for t, now in enumerate(episode):
        ahead = episode[t : t + horizon]
        over = t + horizon >= len(episode)
        later = now if over else episode[t + horizon]
        row = {f"state.{key}": value for key, value in now.state.items()}
        row |= {f"later.{key}": value for key, value in later.state.items()}
        row["action"] = np.array(now.action)
        row["gain"] = np.array(sum(discount**k * one.gained for k, one in enumerate(ahead)), np.float32)
        row["discount"] = np.array(0.0 if over else discount**horizon, np.float32)
        row["mask"] = np.packbits(later.mask & (not over))
        rows.append(row)
    return rows


class Replay:
    """The last `capacity` transitions; `alpha` 0 draws them evenly, 1 in proportion to their error."""

    def __init__(self, capacity: int, actions: int, alpha: float = 0.0) -> None:
        """Make an empty one."""
        self.capacity, self.actions, self.alpha = capacity, actions, alpha
        self.columns: dict[str, np.ndarray] = {}
        self.priority = np.zeros(capacity, np.float32)
        self.added = 0

    def __len__(self) -> int:
        """Return the number of transitions."""
        return min(self.added, self.capacity)

    def add(self, rows: Sequence[dict[str, np.ndarray]]) -> None:
        """Add transitions in place of the oldest, with the highest priority so far."""
        if not self.columns:
            shapes = {key: np.asarray(value) for key, value in rows[0].items()}
            self.columns = {key: np.zeros((self.capacity, *one.shape), one.dtype) for key, one in shapes.items()}
        for row in rows:
            at = self.added % self.capacity
            for key, value in row.items():
                self.columns[key][at] = value
            self.priority[at] = max(float(self.priority.max()), 1.0) if self.alpha else 1.0
            self.added += 1

    def draw(self, rng: np.random.Generator, count: int, beta: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return numbers of transitions, and weights that make up for the draw where `beta` is 1; at most 1."""
        if not self.alpha:
            return rng.integers(len(self), size=count), np.ones(count, np.float32)
        run = self.priority[: len(self)].astype(np.float64).cumsum()
        rows = np.minimum(np.searchsorted(run, rng.random(count) * run[-1], side="right"), len(self) - 1)
        weights = (self.priority[rows] * len(self) / run[-1]) ** -beta
        return rows, (weights / weights.max()).astype(np.float32)

    def rate(self, rows: Int[np.ndarray, " b"], errors: Float[np.ndarray, " b"]) -> None:
        """Set the priority of transitions from what was wrong with their values."""
        if self.alpha:
            self.priority[rows] = (np.abs(errors) + 1e-3) ** self.alpha

    def taken(self, rows: Int[np.ndarray, " b"]) -> Transitions:
        """Return transitions of these numbers."""
        c = self.columns
        state = {key[6:]: one[rows] for key, one in c.items() if key.startswith("state.")}
        later = {key[6:]: one[rows] for key, one in c.items() if key.startswith("later.")}
        mask = np.unpackbits(c["mask"][rows], axis=1, count=self.actions).astype(bool)
        return Transitions(state, c["action"][rows], c["gain"][rows], c["discount"][rows], later, mask)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Return everything as arrays, what was never filled left out."""
        n = len(self)
        kept = {f"column.{key}": one[:n].copy() for key, one in self.columns.items()}
        return kept | {"priority": self.priority[:n].copy(), "added": np.array(self.added)}

    def restore(self, kept: Mapping[str, np.ndarray]) -> None:
        """Take over what `snapshot` gave."""
        self.added = int(kept["added"])
        for key, one in kept.items():
            if key.startswith("column."):
                column = np.zeros((self.capacity, *one.shape[1:]), one.dtype)
                column[: len(one)] = one
                self.columns[key[7:]] = column
        self.priority[: len(self)] = kept["priority"]
