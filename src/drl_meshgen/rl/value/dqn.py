"""The paper's learner, Double DQN (sections 5.2.2, 5.2.3 and 6.1), and the additions of Rainbow as options of it.

`DQNOptions()` are the paper's numbers. Where it says nothing, or this differs:

- Features, rounds and widths of the network are not given: see `networks.GraphNetwork`, `NetworkOptions`.
- The size of N, k and T is not given: those of `EnvironmentOptions`. Corner pairs `(i0, m)` are 60 x 59 for 120 nodes.
- How often the network learns is not given: once every 4 environment steps, the default of the library it was written
  with, from 1,000 transitions on.
- "Steps" of the target network's update and of the convergence rule are read as environment steps, as there; the decay
  of epsilon as once per episode (per step, exploration would end within 220 episodes).
- Rewards include `templates.score.validity_penalty`: the paper's text wants negative Jacobians punished heavily.
- Templates are O-type throughout: how C-type is told apart is left to another work (its reference 45).
- Gradients longer than 10 are cut, as there.
- Weight decay is Adam's L2 term, as in PyTorch.
- Eight episodes run side by side; transitions enter the buffer when their episode ends.
- The 48 hours on a GPU are not there.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from drl_meshgen.rl.checkpoint import Snapshot, restore, state_of
from drl_meshgen.rl.value.episodes import Environment, reach, scored
from drl_meshgen.rl.value.networks import ActionNetwork, tensors
from drl_meshgen.rl.value.replay import Moment, Replay, Transitions, transitions


@dataclass(frozen=True)
class DQNOptions:
    """Numbers of the learner."""

    episodes: int = 8
    """Episodes side by side (count)."""
    learning_rate: float = 1e-4
    """Step of Adam."""
    weight_decay: float = 1e-5
    """Weight of the squared parameters."""
    discount: float = 0.99
    """What a reward counts one step earlier."""
    capacity: int = 50_000
    """Transitions in the buffer (count)."""
    batch: int = 128
    """Transitions per gradient (count)."""
    warmup: int = 1_000
    """Transitions before the first gradient (count)."""
    steps_per_gradient: int = 4
    """Environment steps for each gradient (count)."""
    sync: int = 1_000
    """Environment steps between updates of the target network (count)."""
    epsilon: tuple[float, float] = (1.0, 0.05)
    """Share of random actions, at first and at least."""
    decay: float = 0.999
    """Factor of that share per episode."""
    double: bool = True
    """Whether the online network picks the action whose value the target network gives (eq. 17)."""
    horizon: int = 1
    """Steps after which values are trusted; as long as an episode: Monte-Carlo returns, no target network."""
    alpha: float = 0.0
    """How much priority follows the error, from 0, evenly, to 1."""
    beta: tuple[float, int] = (0.4, 200_000)
    """How much weights make up for that at first, and environment steps until they do so fully."""


RAINBOW = DQNOptions(learning_rate=5e-4, weight_decay=0.0, discount=1.0, epsilon=(1.0, 0.02), horizon=14, alpha=0.5)
"""What is in of Rainbow: double, dueling (an option of the network), priorities, returns over n steps, here to the end
of the episode. Not in: noisy layers, distributions of values. As episodes are never longer than the horizon, the target
network is idle."""


def bellman_errors(
    online: ActionNetwork,
    target: ActionNetwork,
    sample: Transitions,
    environment: Environment,
    *,
    double: bool = True,
) -> Float[torch.Tensor, " b"]:
    """Return `y - Q(s, a)` (eq. 17) with a gradient by `online` alone; their mean square is eq. 16."""
    y = torch.as_tensor(sample.gain)
    going = sample.discount > 0
    if going.any():
        allowed = torch.as_tensor(sample.mask)
        width = reach(sample.mask)
        later = tensors(environment.observation(sample.later))
        with torch.no_grad():
            values = target(later, width)
            chooser = online(later, width) if double else values
            best = chooser.masked_fill(~allowed[:, :width], -torch.inf).argmax(dim=1)
            y = y + torch.as_tensor(sample.discount) * values.gather(1, best[:, None])[:, 0]
    seen = tensors(environment.observation(sample.state))
    return y - online.at(seen, torch.as_tensor(sample.action))


@dataclass
class DQN:
    """What changes while it learns."""

    online: ActionNetwork
    """Network that acts and learns."""
    target: ActionNetwork
    """Its copy of a while ago."""
    options: DQNOptions
    """Numbers of the learner."""
    rng: np.random.Generator
    """Source of everything random but the first weights."""
    actions: int
    """Size of the action space."""
    steps: int = 0
    """Environment steps so far."""
    episodes: int = 0
    """Episodes so far."""
    gradients: int = 0
    """Gradients so far."""
    losses: list[float] = field(default_factory=list)
    """Loss of each gradient since `figures` was last asked."""

    def __post_init__(self) -> None:
        o = self.options
        self.target.load_state_dict(self.online.state_dict())
        self.replay = Replay(o.capacity, self.actions, o.alpha)
        self.optimizer = torch.optim.Adam(
            self.online.parameters(), lr=o.learning_rate, weight_decay=o.weight_decay, fused=True
        )

    @property
    def network(self) -> ActionNetwork:
        """Network whose best-scored actions are the policy."""
        return self.online

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Both networks, by the names of their weights in a checkpoint."""
        return {"online": self.online, "target": self.target}

    @property
    def epsilon(self) -> float:
        """Share of random actions."""
        first, least = self.options.epsilon
        return max(least, first * self.options.decay**self.episodes)

    def figures(self) -> dict[str, float]:
        """Return the loss, a mean since the last call, and epsilon."""
        loss = float(np.mean(self.losses)) if self.losses else np.nan
        self.losses.clear()
        return {"loss": loss, "epsilon": self.epsilon}

    def snapshot(self) -> Snapshot:
        """Return all of it, between episodes, for `restore`."""
        tensors = state_of(self.networks, [self.optimizer])
        tensors |= {f"replay.{key}": torch.as_tensor(one) for key, one in self.replay.snapshot().items()}
        return tensors, {"steps": self.steps, "episodes": self.episodes, "gradients": self.gradients}

    def restore(self, kept: Snapshot) -> None:
        """Go on where `snapshot` was taken; the random generator is the caller's."""
        tensors, counts = kept
        restore(self.networks, [self.optimizer], tensors)
        replay = {key: one.numpy() for key, one in tensors.items() if key.startswith("replay.")}
        self.replay.restore({key.removeprefix("replay."): one for key, one in replay.items()})
        self.steps, self.episodes, self.gradients = (counts[key] for key in ("steps", "episodes", "gradients"))

    def train(self, environment: Environment, until: Callable[[], bool]) -> None:
        """Learn until `until` says so, which is asked whenever all episodes are over."""
        o, n = self.options, environment.count
        pending: list[list[Moment]] = [[] for _ in range(n)]
        while True:
            over = environment.over
            if over.all() and until():
                return
            if over.any():
                environment.begin(over, self.rng.integers(len(environment.domains), size=int(over.sum())))

            # act
            state, masks = environment.state(), environment.masks()
            actions = np.where(masks, self.rng.random(masks.shape), -1.0).argmax(axis=1)
            greedy = self.rng.random(n) >= self.epsilon
            if greedy.any():
                actions = np.where(greedy, scored(self.online, environment).argmax(axis=1), actions)
            gained, done = environment.step(actions)
            for i in range(n):
                at = {key: one[i] for key, one in state.items()}
                pending[i].append(Moment(at, masks[i], int(actions[i]), float(gained[i])))
                if done[i]:
                    self.replay.add(transitions(pending[i], o.horizon, o.discount))
                    self.episodes += 1
                    pending[i] = []
            self.steps += n

            # learn
            due = (self.steps - o.warmup) // o.steps_per_gradient
            while len(self.replay) >= min(o.warmup, o.capacity) and self.gradients < due:
                share = min(1.0, self.steps / o.beta[1])
                rows, weights = self.replay.draw(self.rng, o.batch, o.beta[0] + (1 - o.beta[0]) * share)
                sample = self.replay.taken(rows)
                errors = bellman_errors(self.online, self.target, sample, environment, double=o.double)
                loss = (torch.as_tensor(weights) * errors**2).mean()
                self.optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self.online.parameters(), 10.0)
                self.optimizer.step()
                self.replay.rate(rows, errors.detach().numpy())
                self.losses.append(float(loss.detach()))
                self.gradients += 1
            if self.steps // o.sync > (self.steps - n) // o.sync:
                self.target.load_state_dict(self.online.state_dict())
