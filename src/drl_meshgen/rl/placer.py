"""Placement policy: singular points and line types of an O-type mesh from its four sides.

A multi-layer perceptron answers how far to move from Tutte's embedding of a coarse O-grid. Its answers are averaged
over the eight symmetries of the square, so naming, turning or mirroring the domain makes no difference. Its last layer
begins at zero: training starts at the embedding, with straight lines.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from drl_meshgen.rl import boundary
from drl_meshgen.rl.boundary import PER_SIDE
from drl_meshgen.templates.corners import reference

EXTRAS: Final = 2
"""Numbers that no symmetry changes: those of `log_counts`."""
SEEN: Final = 8 * PER_SIDE + 2 + EXTRAS
"""Inputs: 16 samples a side, m / L and n / L, and the extras."""
ANSWERED: Final = 24
"""Outputs: four singular points and eight bulges, each two numbers."""
MOST_BULGE: Final = 0.6
"""Largest amplitude of a bow or S, in chords."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What the policy sees of `b` four-sided domains, in their frames, and how its answers return from there."""

    seen: Float[torch.Tensor, "b s"]
    singular: Float[torch.Tensor, "b 4 2"]
    """Tutte's singular points, in the frame."""
    origin: Float[torch.Tensor, "b 2"]
    direction: Float[torch.Tensor, "b 2"]

    @classmethod
    def of(
        cls,
        rim: Float[np.ndarray, "b r 2"],
        m: Int[np.ndarray, " b"],
        size: Int[np.ndarray, " b"] | int,
        layers: Int[np.ndarray, " b"] | int,
    ) -> "Scene":
        """Look at domains of unit scale with `size` nodes; `rim` as `side_samples` gives it."""
        z = rim[..., 0] + 1j * rim[..., 1]
        origin, direction = boundary.square_frame(z)
        z = (z - origin) / direction
        samples = np.stack([z.real, z.imag], axis=-1)
        share = m / size
        counts = np.broadcast_arrays(2 * share, 1 - 2 * share, *log_counts(size, layers), share)[:-1]
        seen = np.concatenate([samples.reshape(len(z), -1), np.stack(counts, axis=1)], axis=1)
        matrix, _ = reference(PER_SIDE // 2, 3)
        start = 3 * 2 * PER_SIDE
        singular = matrix[start : start + 2 * PER_SIDE : PER_SIDE // 2] @ samples[:, ::2]
        return cls(
            torch.as_tensor(seen),
            torch.as_tensor(singular),
            torch.as_tensor(np.concatenate([np.real(origin), np.imag(origin)], axis=1)),
            torch.as_tensor(np.concatenate([np.real(direction), np.imag(direction)], axis=1)),
        )

    def placed(
        self, answer: Float[torch.Tensor, "b 24"]
    ) -> tuple[Float[torch.Tensor, "b 4 2"], Float[torch.Tensor, "b 8 2"]]:
        """Return singular points in the plane, and bulges."""
        x, y = (self.singular + answer[:, :8].reshape(-1, 4, 2)).unbind(dim=-1)
        c, s = self.direction[:, :1], self.direction[:, 1:]
        singular = torch.stack([c * x - s * y, s * x + c * y], dim=-1) + self.origin[:, None]
        return singular, MOST_BULGE * torch.tanh(answer[:, 8:].reshape(-1, 8, 2) / MOST_BULGE)


def log_counts(size: Int[np.ndarray, " b"] | int, layers: Int[np.ndarray, " b"] | int) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers of boundary nodes and layers, on a scale on which networks learn them."""
    return np.log(np.asarray(size) / 100), np.log(np.asarray(layers) / 6)


class Placer(nn.Module):
    """The placement policy; parameters in single precision."""

    def __init__(self, width: int = 384, depth: int = 3) -> None:
        """Set up `depth` hidden layers of `width` units."""
        super().__init__()
        self.width = width
        sizes = [SEEN, *[width] * depth]
        layers = [part for a, b in pairwise(sizes) for part in (nn.Linear(a, b), nn.SiLU())]
        last = nn.Linear(width, ANSWERED)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.body = nn.Sequential(*layers, last)
        self._columns = torch.as_tensor(boundary.SAMPLES), torch.as_tensor(boundary.CONTROLS)
        self._signs = torch.as_tensor(boundary.SAMPLE_SIGNS).float(), torch.as_tensor(boundary.CONTROL_SIGNS).float()

    def forward(self, seen: Float[torch.Tensor, "b s"]) -> Float[torch.Tensor, "b 24"]:
        """Return answers for `Scene.placed`, averaged over the symmetries."""
        x = seen.float()
        turned = x[:, self._columns[0]] * self._signs[0]  # (b, 8, samples and shares)
        extras = x[:, None, -EXTRAS:].expand(-1, turned.shape[1], -1)
        answer = self.body(torch.cat([turned, extras], dim=-1))
        back = answer.gather(2, self._columns[1].expand(len(x), -1, -1))
        return (back * self._signs[1]).mean(dim=1).double()
