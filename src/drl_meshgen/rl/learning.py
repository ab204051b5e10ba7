"""The project's learner: corner values by regression on exact rewards, placement by the reward's own gradient.

Every step takes some domains and some choices of corners of each, by softmax of their values or at random. Meshes are
made from what the placement policy answers; the gradient of their reward, on coarse meshes, goes straight into the
policy, and the exact reward becomes the target of the corners' value. Nothing is bootstrapped: an episode is one step
long, since the reward is known as soon as the parameters are. Recipe and figures: docs/learning.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int
from torch import nn

from drl_meshgen.rl.agent import AgentOptions, AgentPolicy
from drl_meshgen.rl.boundary import PER_SIDE, side_samples
from drl_meshgen.rl.controls import SHAPED
from drl_meshgen.rl.domains import resampled
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.networks import CornerValue, Placer, weights_of
from drl_meshgen.rl.scene import Scene, corner_choices, views
from drl_meshgen.rl.surrogate import Surrogate
from drl_meshgen.rl.symmetry import of_square
from drl_meshgen.rl.worth import Worth
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.score import Weights


@dataclass(frozen=True)
class LearnOptions:
    """What training is made of."""

    seed: int = 1
    """Seed of weights and draws."""
    steps: int = 13_500
    """Steps from nothing to the end."""
    polish: int = 1_500
    """The last of them, in which even edges count as well."""
    domains: int = 16
    """Domains of a step, half of them hard."""
    sizes: tuple[int, ...] = (100, 100, 100, 24, 100, 40, 100, 64, 100, 160, 100, 250)
    """Numbers of boundary nodes, taking turns."""
    nominal: int = 3
    """Layers for which corners are valued."""
    layers: tuple[int, int] = (3, 10)
    """Fewest and most layers that are placed."""
    temperature: float = 0.01
    """Of the softmax by which corners are drawn (reward)."""
    soft: tuple[int, int] = (2, 4)
    """Choices of each domain drawn by softmax: those that teach both networks, and those that teach values alone."""
    anyhow: tuple[int, int] = (1, 4)
    """The same drawn evenly; the most valuable choice teaches both besides."""
    anyhow_weight: float = 0.25
    """Weight of choices drawn evenly in the placement's loss, against 1."""
    drawn: int = 100
    """Choices of corners of each domain between which it draws."""
    rate: float = 1e-3
    """Step length of Adam; it stays so for a third of training, then falls along a cosine; once more at the end."""
    divisions: tuple[int, int] = (8, 16)
    """Cells per side of the coarse meshes, in the first 60 % of training and later."""
    width: int = 384
    """Units of each hidden layer of the placement policy."""
    answered: int = SHAPED
    """Continuous parameters: `controls.PLAIN` for those of the paper, `SHAPED` with waves and swells."""
    smoothness: float = 0.45
    """Weight of even edges along lines in the placement's loss, at the end; the reward knows nothing of them."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward."""


class Bank:
    """Training domains of unit scale, resampled to any number of nodes on demand."""

    def __init__(self, standard: Sequence[Domain], hard: Sequence[Domain]) -> None:
        """Take the domains of both kinds."""
        self.kinds = [[domain.frame.to_local(domain.nodes) for domain in kind] for kind in (standard, hard)]

    def drawn(self, rng: np.random.Generator, count: int, size: int) -> Float[np.ndarray, "b l 2"]:
        """Return `count` domains of `size` nodes, the kinds taking turns."""
        kinds = [self.kinds[i % 2] for i in range(count)]
        return np.stack([resampled(kind[int(rng.integers(len(kind)))], size) for kind in kinds])


class Learner:
    """Networks and optimisers at some step of training; draws depend on seed and step alone."""

    def __init__(self, bank: Bank, options: LearnOptions | None = None) -> None:
        """Set up the networks from the seed."""
        self.options, self.bank, self.step = options or LearnOptions(), bank, 0
        torch.manual_seed(self.options.seed)
        self.corner, self.placer = CornerValue(), Placer(of_square(self.options.answered), self.options.width)
        self.optimisers = self._optimisers()
        self.coarse = {d: Surrogate(d, 3) for d in self.options.divisions}

    def _optimisers(self) -> list[torch.optim.Adam]:
        return [torch.optim.Adam(part.parameters(), self.options.rate) for part in (self.corner, self.placer)]

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Its networks, by the names of their weights in a policy."""
        return {"corner": self.corner, "placer": self.placer}

    @property
    def polishing(self) -> bool:
        """Whether even edges count."""
        return self.step >= self.options.steps - self.options.polish

    @property
    def done(self) -> float:
        """Share of training, or of its end, that is over."""
        main = self.options.steps - self.options.polish
        return (self.step - main) / self.options.polish if self.polishing else self.step / main

    def advance(self) -> tuple[float, float]:
        """Take one step; return the mean worth of its most valuable choices and the error of the values."""
        o, done = self.options, self.done
        if self.polishing and done == 0:
            # their moments are those of another loss, with far smaller gradients
            self.optimisers = self._optimisers()
        rng = np.random.default_rng([o.seed, self.step])
        size = o.sizes[self.step % len(o.sizes)]
        nodes = self.bank.drawn(rng, o.domains, size)
        fraction = max(0.0, (done - 1 / 3) * 1.5)
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = max(o.rate * (1 + np.cos(np.pi * fraction)) / 2, o.rate / 100)
        pairs, four = corner_choices(size, size**2)
        some = rng.integers(0, len(pairs), (o.domains, o.drawn))
        value = self.corner(torch.as_tensor(views(nodes)), torch.as_tensor(four[some]))
        picks = self._picks(value.detach().numpy(), rng)
        which = np.tile(np.arange(o.domains), (len(picks), 1))
        corners = pairs[some[which, picks]]
        layers = np.full(picks.shape, o.nominal)
        layers[2] = rng.integers(o.layers[0], o.layers[1] + 1, o.domains)
        divisions = o.divisions[int(done >= 0.6 or self.polishing)]
        exact = self._placed(nodes, which, corners, layers, divisions)
        valued = layers == o.nominal
        error = value[which, picks] - torch.as_tensor(exact.clip(0, 1)).float()
        loss = error[torch.as_tensor(valued)].square().mean()
        self._descend(0, loss)
        self.step += 1
        return float(exact[0].mean()), float(loss.detach()) ** 0.5

    def _picks(self, value: Float[np.ndarray, "d c"], rng: np.random.Generator) -> Int[np.ndarray, "p d"]:
        """Return choices for every domain: the most valuable, then by softmax, then any."""
        o = self.options
        soft = o.soft[0] + o.soft[1]
        lots = value / o.temperature + rng.gumbel(size=(soft, *value.shape))
        anyhow = rng.integers(0, o.drawn, (sum(o.anyhow), o.domains))
        soft_picks, best = lots.argmax(axis=2), value.argmax(axis=1)[None]
        parts = best, soft_picks[: o.soft[0]], anyhow[: o.anyhow[0]], soft_picks[o.soft[0] :], anyhow[o.anyhow[0] :]
        return np.concatenate(parts)

    def _placed(
        self,
        nodes: Float[np.ndarray, "d l 2"],
        which: Int[np.ndarray, "p d"],
        corners: Int[np.ndarray, "p d 2"],
        layers: Int[np.ndarray, "p d"],
        divisions: int,
    ) -> Float[np.ndarray, "p d"]:
        """Improve the placement of the first of these choices of corners; return what each was worth."""
        o, coarse, size = self.options, self.coarse[divisions], nodes.shape[1]
        shape, taught = which.shape, (1 + o.soft[0] + o.anyhow[0]) * o.domains
        which, corners, layers = which.ravel(), corners.reshape(-1, 2), layers.ravel()
        rim = side_samples(nodes[which], corners, PER_SIDE)
        scene = Scene.of(rim, corners[:, 1], size, layers).each(torch.as_tensor)
        answers = self._answers(scene.seen, taught)
        parts = scene.placed(answers, torch.tanh)
        m = torch.as_tensor(corners[:taught, 1])
        share = coarse.share(m, size // 2 - m, torch.as_tensor(layers[:taught]))
        coarse_rim = torch.as_tensor(rim[:taught, :: PER_SIDE // divisions])
        some = {name: part[:taught] for name, part in parts.items()}
        worth = self.worth(coarse, coarse_rim, some, share)
        if self.polishing:
            k = torch.as_tensor(layers[:taught])
            worth = worth + o.smoothness * coarse.smoothness(coarse.points(coarse_rim, **some), m, size // 2 - m, k)
        relevance = torch.ones(taught)
        relevance[(1 + o.soft[0]) * o.domains :] = o.anyhow_weight
        self._descend(1, -(relevance * worth).sum() / relevance.sum())
        found = {name: part.detach().numpy() for name, part in parts.items()}
        exact = np.empty(len(which))
        for b, d in enumerate(which):
            one = slice(b, b + 1)
            exact[b] = self.exact(
                nodes[d], corners[one], layers[one], {name: part[one] for name, part in found.items()}
            )
        return exact.reshape(shape)

    def _answers(self, seen: Float[torch.Tensor, "b s"], taught: int) -> Float[torch.Tensor, "b c"]:
        """Return answers for these scenes, with a gradient those of the first `taught` alone."""
        with torch.no_grad():
            rest = self.placer(seen[taught:])
        return torch.cat([self.placer(seen[:taught]), rest])

    def worth(
        self,
        coarse: Surrogate,
        rim: Float[torch.Tensor, "b r 2"],
        parts: Mapping[str, torch.Tensor],
        share: Float[torch.Tensor, "b q"],
    ) -> Float[torch.Tensor, " b"]:
        """Return what coarse meshes are worth, with a gradient."""
        return Worth.apply(coarse.points(rim, **parts), coarse.quads, share, self.options.weights)

    def exact(
        self,
        nodes: Float[np.ndarray, "l 2"],
        corners: Int[np.ndarray, "1 2"],
        layers: Int[np.ndarray, "1"],
        parts: Mapping[str, np.ndarray],
    ) -> float:
        """Return what one mesh is worth."""
        judged = judge_o(nodes, corners, layers, weights=self.options.weights, **parts)
        return float((judged.reward - judged.penalty)[0])

    def _descend(self, part: int, loss: torch.Tensor) -> None:
        network, optimiser = (self.corner, self.placer)[part], self.optimisers[part]
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()

    @property
    def episodes(self) -> int:
        """Meshes that were made and judged so far."""
        o = self.options
        return self.step * o.domains * (1 + sum(o.soft) + sum(o.anyhow))

    def policy(self, options: AgentOptions | None = None) -> AgentPolicy:
        """Return the policy as it is now."""
        return AgentPolicy(weights_of(self.networks), options)


def examine(policy: AgentPolicy, domains: Sequence[Domain]) -> pd.DataFrame:
    """Return a row per domain: reward, orthogonality, jacobian, valid, of the best of the first proposals."""
    rows = []
    for domain in domains:
        nodes = domain.frame.to_local(domain.nodes)
        found = policy.proposals(nodes, policy.corners([nodes], policy.options.tried)[0], policy.options.layers)
        judged, best = found.judged, found.judged.best
        rows.append(
            {
                "reward": judged.reward[best] if judged.valid[best] else 0.0,
                "orthogonality": judged.orthogonality[best],
                "jacobian": judged.jacobian[best],
                "valid": judged.valid[best],
            }
        )
    return pd.DataFrame(rows)
