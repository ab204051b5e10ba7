"""Proximal policy optimisation (Schulman et al. 2017) with masks (Huang and Ontanon 2022), episodes of equal length.

Own and compact: the PPO of stable-baselines3 knows no masks, and its extension would be another dependency.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import nn

from drl_meshgen.rl.checkpoint import Snapshot, restore, state_of
from drl_meshgen.rl.value.episodes import Environment, reach
from drl_meshgen.rl.value.networks import RelativeNetwork, tensors
from drl_meshgen.rl.vector import State


@dataclass(frozen=True)
class PPOOptions:
    """Numbers of the learner."""

    episodes: int = 128
    """Episodes side by side, played to their end for each round of learning (count)."""
    learning_rate: float = 1e-3
    """Step of Adam, at first."""
    halving: int = 600_000
    """Environment steps in which it is halved."""
    epochs: int = 3
    """Times that each round is learnt from (count)."""
    batch: int = 448
    """Moments per gradient (count)."""
    clip: float = 0.2
    """How far the probability of an action may change in one round, as a share."""
    trace: float = 0.95
    """Lambda of the generalised advantage; rewards are not discounted."""
    entropy: float = 0.003
    """Weight of the entropy of the policy."""
    value: float = 0.5
    """Weight of the squared error of the values."""


class Rollout(NamedTuple):
    """`t` moments of each of `n` episodes, flattened to `b = t n`."""

    state: State
    mask: Bool[np.ndarray, "b a"]
    action: Int[np.ndarray, " b"]
    chance: Float[np.ndarray, " b"]
    """Logarithm of the probability with which the action was taken."""
    advantage: Float[np.ndarray, " b"]
    value: Float[np.ndarray, " b"]
    """What the value of the state should have been."""


def chances(scores: Float[torch.Tensor, "b w"], mask: Bool[torch.Tensor, "b w"]) -> Float[torch.Tensor, "b w"]:
    """Return logarithms of probabilities; forbidden actions have none (a very negative finite number)."""
    return scores.masked_fill(~mask, -1e8).log_softmax(dim=1)


def advantages(
    gained: Float[np.ndarray, "t n"], values: Float[np.ndarray, "t n"], trace: float
) -> Float[np.ndarray, "t n"]:
    """Return generalised advantages (Schulman et al. 2016) of finished episodes, without discount."""
    found, run = np.zeros_like(values), np.zeros(values.shape[1])
    later = np.concatenate([values[1:], np.zeros_like(values[:1])])
    for t in reversed(range(len(values))):
        run = gained[t] + later[t] - values[t] + trace * run
        found[t] = run
    return found


def policy_loss(
    chance: Float[torch.Tensor, " b"],
    before: Float[torch.Tensor, " b"],
    advantage: Float[torch.Tensor, " b"],
    clip: float,
) -> torch.Tensor:
    """Return the clipped surrogate; `chance` and `before` are logarithms of probabilities now and then."""
    ratio = (chance - before).exp()
    return -torch.minimum(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage).mean()


@dataclass
class PPO:
    """What changes while it learns."""

    network: RelativeNetwork
    """Scores of actions, before softmax, and values of states."""
    options: PPOOptions
    """Numbers of the learner."""
    rng: np.random.Generator
    """Source of everything random but the first weights."""
    steps: int = 0
    """Environment steps so far."""
    episodes: int = 0
    """Episodes so far."""
    losses: list[float] = field(default_factory=list)
    """Loss of each gradient since `figures` was last asked."""

    def __post_init__(self) -> None:
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=self.options.learning_rate, fused=True)

    def figures(self) -> dict[str, float]:
        """Return the loss, a mean since the last call; there is no epsilon."""
        loss = float(np.mean(self.losses)) if self.losses else np.nan
        self.losses.clear()
        return {"loss": loss, "epsilon": np.nan}

    def snapshot(self) -> Snapshot:
        """Return all of it, between episodes, for `restore`."""
        tensors = state_of({"network": self.network}, [self.optimizer])
        return tensors, {"steps": self.steps, "episodes": self.episodes}

    def restore(self, kept: Snapshot) -> None:
        """Go on where `snapshot` was taken; the random generator is the caller's."""
        tensors, counts = kept
        restore({"network": self.network}, [self.optimizer], tensors)
        self.steps, self.episodes = counts["steps"], counts["episodes"]

    def train(self, environment: Environment, until: Callable[[], bool]) -> None:
        """Learn until `until` says so, which is asked whenever all episodes are over."""
        o = self.options
        while not until():
            played = self.rollout(environment)
            for group in self.optimizer.param_groups:
                group["lr"] = o.learning_rate * 0.5 ** (self.steps / o.halving)
            for _ in range(o.epochs):
                order = self.rng.permutation(len(played.action))
                for rows in np.split(order, range(o.batch, len(order), o.batch)):
                    loss = self.loss(environment, played, rows)
                    self.optimizer.zero_grad()
                    loss.backward()
                    nn.utils.clip_grad_norm_(self.network.parameters(), 0.5)
                    self.optimizer.step()
                    self.losses.append(float(loss.detach()))

    @torch.no_grad()
    def rollout(self, environment: Environment) -> Rollout:
        """Play all episodes from their beginning to their end; actions are drawn by the policy."""
        n = environment.count
        environment.begin(np.ones(n, bool), self.rng.integers(len(environment.domains), size=n))
        moments = []
        while not environment.over.all():
            state, mask = environment.state(), environment.masks()
            width = reach(mask)
            scores, values = self.network.both(tensors(environment.observation(state)), width)
            chance = chances(scores, torch.as_tensor(mask[:, :width])).numpy()
            gumbel = -np.log(-np.log(self.rng.random(chance.shape)))
            action = np.where(mask[:, :width], chance + gumbel, -np.inf).argmax(axis=1)
            gained, _ = environment.step(action)
            moments.append((state, mask, action, chance[np.arange(n), action], gained, values.numpy()))
        state, mask, action, chance, gained, value = zip(*moments, strict=True)
        found = advantages(np.array(gained), np.array(value), self.options.trace)
        wanted = found + np.array(value)
        self.steps += n * len(moments)
        self.episodes += n
        return Rollout(
            {key: np.concatenate([one[key] for one in state]) for key in state[0]},
            np.concatenate(mask),
            np.concatenate(action),
            np.concatenate(chance),
            ((found - found.mean()) / (found.std() + 1e-8)).ravel().astype(np.float32),
            wanted.ravel().astype(np.float32),
        )

    def loss(self, environment: Environment, played: Rollout, rows: Int[np.ndarray, " b"]) -> torch.Tensor:
        """Return the loss of some moments: of the policy, of the values, and less the entropy."""
        mask = played.mask[rows]
        width = reach(mask)
        seen = tensors(environment.observation({key: one[rows] for key, one in played.state.items()}))
        scores, values = self.network.both(seen, width)
        chance = chances(scores, torch.as_tensor(mask[:, :width]))
        taken = chance.gather(1, torch.as_tensor(played.action[rows])[:, None])[:, 0]
        entropy = -(chance.exp() * chance).sum(dim=1).mean()
        policy = policy_loss(
            taken, torch.as_tensor(played.chance[rows]), torch.as_tensor(played.advantage[rows]), self.options.clip
        )
        wrong = ((values - torch.as_tensor(played.value[rows])) ** 2).mean()
        return policy + self.options.value * wrong - self.options.entropy * entropy
