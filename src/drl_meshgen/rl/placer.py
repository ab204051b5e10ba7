"""Placement policy: singular points, line types, waves and swells of an O-type mesh from its four sides.

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
from drl_meshgen.rl.controls import SHAPED, parts_of
from drl_meshgen.templates.corners import reference

EXTRAS: Final = 2
"""Numbers that no symmetry changes: those of `log_counts`."""
SEEN: Final = 8 * PER_SIDE + 2 + EXTRAS
"""Inputs: 16 samples a side, m / L and n / L, and the extras."""
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

    def placed(self, answer: Float[torch.Tensor, "b c"]) -> dict[str, Float[torch.Tensor, "b *d 2"]]:
        """Return what was answered as fields of `OParameters`, in the plane."""
        parts = parts_of(answer)
        found = {"singular": self._turned(self.singular + parts["singular"]) + self.origin[:, None]}
        found["bulges"] = MOST_BULGE * torch.tanh(parts["bulges"] / MOST_BULGE)
        return found | {name: self._turned(parts[name]) for name in ("waves", "swells") if name in parts}

    def _turned(self, vectors: Float[torch.Tensor, "b *d 2"]) -> Float[torch.Tensor, "b *d 2"]:
        """Return vectors of the frame in the plane."""
        x, y = vectors.unbind(dim=-1)
        c, s = (part.reshape(-1, *[1] * (x.ndim - 1)) for part in self.direction.unbind(dim=-1))
        return torch.stack([c * x - s * y, s * x + c * y], dim=-1)


def log_counts(size: Int[np.ndarray, " b"] | int, layers: Int[np.ndarray, " b"] | int) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers of boundary nodes (at least 24) and layers, on a scale on which networks learn them."""
    return np.log(np.maximum(size, 24) / 100), np.log(np.asarray(layers) / 6)


class Placer(nn.Module):
    """The placement policy; parameters in single precision."""

    def __init__(self, width: int = 384, depth: int = 3, answered: int = SHAPED) -> None:
        """Set up `depth` hidden layers of `width` units; `answered` is `PLAIN` or `SHAPED` parameters."""
        super().__init__()
        self.width, self.answered = width, answered
        sizes = [SEEN, *[width] * depth]
        layers = [part for a, b in pairwise(sizes) for part in (nn.Linear(a, b), nn.SiLU())]
        last = nn.Linear(width, answered)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.body = nn.Sequential(*layers, last)
        tables = boundary.SAMPLES, boundary.CONTROLS[:, :answered]
        signs = boundary.SAMPLE_SIGNS, boundary.CONTROL_SIGNS[:, :answered]
        self._columns, self._signs = (
            [torch.as_tensor(one) for one in tables],
            [torch.as_tensor(one).float() for one in signs],
        )

    def forward(self, seen: Float[torch.Tensor, "b s"]) -> Float[torch.Tensor, "b c"]:
        """Return answers for `Scene.placed`, averaged over the symmetries."""
        x = seen.float()
        turned = x[:, self._columns[0]] * self._signs[0]  # (b, 8, samples and shares)
        extras = x[:, None, -EXTRAS:].expand(-1, turned.shape[1], -1)
        answer = self.body(torch.cat([turned, extras], dim=-1))
        back = answer.gather(2, self._columns[1].expand(len(x), -1, -1))
        return (back * self._signs[1]).mean(dim=1).double()
