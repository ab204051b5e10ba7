"""Training of the placement policy of C-type meshes, by the reward's own gradient on coarse meshes.

Shapes, their nodes and the counts of cells are drawn anew at every step. What counts are best is not learnt: placing
and judging a few dozen costs milliseconds (`transitions.best_transition`).
"""

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import nn

from drl_meshgen.rl.agent import TRANSITIONS
from drl_meshgen.rl.c_domains import divided, drawn_counts, drawn_shape, drawn_sides
from drl_meshgen.rl.c_scene import PER_PART, CScene, counts_of, part_samples
from drl_meshgen.rl.c_surrogate import CSurrogate
from drl_meshgen.rl.networks import Placer
from drl_meshgen.rl.symmetry import of_transition
from drl_meshgen.rl.worth import Worth
from drl_meshgen.templates.score import Weights


@dataclass(frozen=True)
class TransitionLearnOptions:
    """What training is made of."""

    seed: int = 1
    """Seed of weights, shapes and draws."""
    steps: int = 12_000
    """Steps from nothing to the end."""
    shapes: int = 4_000
    """Shapes that domains are made from."""
    domains: int = 16
    """Domains of a step."""
    choices: int = 6
    """Counts of cells of each."""
    sizes: tuple[int, ...] = (100, 24, 100, 40, 64, 160, 32, 250)
    """Numbers of boundary nodes, taking turns."""
    rate: float = 1e-3
    """Step length of Adam; it falls along a cosine."""
    divisions: tuple[int, int] = (4, 8)
    """Cells along each side of a coarse block, in the first 60 % of training and later; multiples of 4."""
    width: int = 256
    """Units of each hidden layer."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward."""


class TransitionLearner:
    """Network and optimiser at some step of training; draws depend on seed and step alone."""

    def __init__(self, options: TransitionLearnOptions | None = None) -> None:
        """Set up the network and the shapes from the seed."""
        self.options, self.step = options or TransitionLearnOptions(), 0
        o = self.options
        torch.manual_seed(o.seed)
        self.placer = Placer(of_transition(), o.width)
        self.optimisers = [torch.optim.Adam(self.placer.parameters(), o.rate)]
        self.coarse = {d: CSurrogate(d) for d in o.divisions}
        # a second entry, lest the shapes be those of a test set
        self._shapes = [drawn_shape(np.random.default_rng([o.seed, 0, i]))[0] for i in range(o.shapes)]

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Its network, by the name of its weights in a policy."""
        return {TRANSITIONS: self.placer}

    def advance(self) -> float:
        """Take one step; return the mean worth of its coarse meshes."""
        o, done = self.options, self.step / self.options.steps
        rng = np.random.default_rng([o.seed, 1, self.step])
        (optimiser,) = self.optimisers
        for group in optimiser.param_groups:
            group["lr"] = max(o.rate * (1 + np.cos(np.pi * done)) / 2, o.rate / 100)
        size, coarse = o.sizes[self.step % len(o.sizes)], self.coarse[o.divisions[int(done >= 0.6)]]
        nodes, counts = [], []
        for i in rng.integers(0, len(self._shapes), o.domains).tolist():
            sides = drawn_sides(rng, self._shapes[i], size)
            nodes.append(divided(rng, self._shapes[i], sides))
            counts.extend(drawn_counts(rng, sides) for _ in range(o.choices))
        rims = np.array([one.rim for one in counts])
        rim = part_samples(np.repeat(nodes, o.choices, axis=0), np.zeros(len(rims), np.int64), rims, coarse.divisions)
        cells = counts_of(counts)
        scene = CScene.of(rim[:, :: coarse.divisions // PER_PART], cells).each(torch.as_tensor)
        parts = scene.placed(self.placer(scene.seen), torch.tanh)
        points = coarse.points(torch.as_tensor(rim), **parts)
        worth = Worth.apply(points, coarse.quads, coarse.share(torch.as_tensor(cells)), o.weights)
        optimiser.zero_grad()
        (-worth.mean()).backward()
        nn.utils.clip_grad_norm_(self.placer.parameters(), 1.0)
        optimiser.step()
        self.step += 1
        return float(worth.mean().detach())
