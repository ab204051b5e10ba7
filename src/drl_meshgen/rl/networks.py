"""The networks in PyTorch, for training; `inference` runs the same weights without it.

Corner values: each node sees the boundary around it; corners and sides are pooled, and the mirrored domain counts the
same, so turning, mirroring or renumbering the domain renumbers the values. Placement, of O-type and of C-type meshes:
a multi-layer perceptron answers how far to move from Tutte's embedding of a coarse grid. Its answers are averaged over
the ways to name the same domain, eight or two, so naming, turning or mirroring it makes no difference. Its last layer
begins at zero: training starts at the embedding, with straight lines.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from drl_meshgen.rl.scene import SHARES, VIEWED
from drl_meshgen.rl.symmetry import Symmetry


def mirrored(seen: Float[torch.Tensor, "b l s"]) -> Float[torch.Tensor, "b l s"]:
    """Return what the same nodes see in the mirrored domain: ahead and back change places, and the tangent turns."""
    n = len(SHARES)
    ahead, back, up, down, extras = seen.split([n, n, n, n, 2], dim=-1)
    return torch.cat([-back, -ahead, down, up, extras], dim=-1)


class CornerValue(nn.Module):
    """The value of every choice of corners; single precision."""

    def __init__(self, width: int = 96, pooled: int = 16) -> None:
        """Set up two hidden layers for nodes and one for choices."""
        super().__init__()
        self.width = width
        self.node = nn.Sequential(
            nn.Linear(VIEWED, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 3 * pooled)
        )
        self.choice = nn.Sequential(nn.Linear(2 * pooled + 2, width), nn.SiLU(), nn.Linear(width, 1))

    def forward(
        self, seen: Float[torch.Tensor, "b l s"], corners: Int[torch.Tensor, "b c 4"]
    ) -> Float[torch.Tensor, "b c"]:
        """Return the values of choices of four nodes of each domain, in order around it."""
        x = seen.float()
        size = seen.shape[1]
        across = ((corners[..., 1] - corners[..., 0]) % size / size).float()
        even = across * (0.5 - across)  # the same for m and n
        shape = torch.stack([16 * even - 0.5, even.clamp_min(1e-6).log() + 3], dim=-1)
        rows = corners + size * torch.arange(len(seen))[:, None, None]
        value = torch.zeros(())
        for turn, view in ((-1, x), (1, mirrored(x))):
            corner = nn.functional.embedding(rows, self.node(view).flatten(0, 1))
            alone, first, second = corner.chunk(3, dim=-1)
            side = (first * second.roll(turn, dims=2)).mean(dim=2)
            pooled = torch.cat([alone.mean(dim=2), side, shape], dim=-1)
            value = value + self.choice(pooled).squeeze(-1) / 2
        return value


class Placer(nn.Module):
    """A placement policy; parameters in single precision."""

    def __init__(self, symmetry: Symmetry, width: int = 384, depth: int = 3) -> None:
        """Set up `depth` hidden layers of `width` units for what the symmetry permutes."""
        super().__init__()
        sizes = [symmetry.seen.shape[1], *[width] * depth]
        layers = [part for a, b in pairwise(sizes) for part in (nn.Linear(a, b), nn.SiLU())]
        last = nn.Linear(width, symmetry.answered.shape[1])
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.body = nn.Sequential(*layers, last)
        self._columns = torch.as_tensor(symmetry.seen), torch.as_tensor(symmetry.answered)
        self._signs = torch.as_tensor(symmetry.seen_signs).float(), torch.as_tensor(symmetry.answered_signs).float()

    def forward(self, seen: Float[torch.Tensor, "b s"]) -> Float[torch.Tensor, "b c"]:
        """Return answers for a scene's `placed`, averaged over the symmetries."""
        answer = self.body(seen.float()[:, self._columns[0]] * self._signs[0])  # (b, symmetries, answers)
        back = answer.gather(2, self._columns[1].expand(len(seen), -1, -1))
        return (back * self._signs[1]).mean(dim=1).double()


def weights_of(networks: Mapping[str, nn.Module]) -> dict[str, np.ndarray]:
    """Return the weights of networks, each called `network.name`."""
    states = {part: network.state_dict() for part, network in networks.items()}
    return {f"{part}.{name}": value.numpy().copy() for part, state in states.items() for name, value in state.items()}


def load(networks: Mapping[str, nn.Module], weights: Mapping[str, np.ndarray]) -> None:
    """Give networks their weights, as `weights_of` names them."""
    for part, network in networks.items():
        own = {k.removeprefix(f"{part}."): torch.as_tensor(v) for k, v in weights.items() if k.startswith(f"{part}.")}
        network.load_state_dict(own)
