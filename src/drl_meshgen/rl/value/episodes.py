"""What learners ask of an environment, and episodes played by a network in it."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from drl_meshgen.rl.value.networks import Batch, tensors
from drl_meshgen.rl.vector import Observation, State

Values = Callable[[Batch, int], Float[torch.Tensor, "b w"]]
"""What scores the first so many actions of b states."""


class Environment(Protocol):
    """Episodes side by side; `drl_meshgen.rl.vector.VectorEnvironment` is one."""

    count: int

    @property
    def domains(self) -> Sequence[Any]:
        """What episodes take place in."""
        ...

    @property
    def actions(self) -> int:
        """Size of the action space."""
        ...

    @property
    def over(self) -> Bool[np.ndarray, " n"]:
        """Which episodes are over; all before the first."""
        ...

    def begin(self, which: Bool[np.ndarray, " n"], domains: Int[np.ndarray, " k"]) -> None:
        """Begin these episodes anew in domains of these numbers."""
        ...

    def state(self) -> State:
        """Return the state of all episodes."""
        ...

    def observation(self, state: State) -> Observation:
        """Return what a network sees of states."""
        ...

    def masks(self) -> Bool[np.ndarray, "n a"]:
        """Return which actions count."""
        ...

    def step(self, actions: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Act; return what was gained and which episodes are over."""
        ...


def reach(masks: Bool[np.ndarray, "b a"]) -> int:
    """Return how many actions have to be scored so that all that count are among them."""
    return int(np.flatnonzero(masks.any(axis=0))[-1]) + 1


@torch.no_grad()
def scored(values: Values, environment: Environment) -> Float[np.ndarray, "n a"]:
    """Return what a network gives for every action of every episode; -inf where the mask forbids it."""
    masks = environment.masks()
    width = reach(masks)
    found = values(tensors(environment.observation(environment.state())), width).numpy()
    return np.where(masks, np.pad(found, ((0, 0), (0, masks.shape[1] - width))), -np.inf)


def play(values: Values, environment: Environment, domains: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Play greedy episodes, which all take as many steps, in these domains; return what each gained."""
    environment.begin(np.ones(environment.count, bool), domains)
    total = np.zeros(environment.count)
    while not environment.over.all():
        total += environment.step(scored(values, environment).argmax(axis=1))[0]
    return total
