"""Corner values: what the mesh will be worth for each choice of corners, as a function of the whole boundary.

Each node sees the boundary around it at fixed shares of the length, in its own tangent frame; corners and sides are
pooled, and the mirrored domain counts the same. Turning, mirroring or renumbering the domain renumbers the values.
"""

from functools import cache
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

#: Where a node looks along the boundary, ahead and back, as shares of its nodes.
SHARES: Final = (
    0.01,
    0.02,
    0.03,
    0.045,
    0.06,
    0.08,
    0.105,
    0.13,
    0.16,
    0.19,
    0.22,
    0.25,
    0.29,
    0.33,
    0.37,
    0.41,
    0.455,
)
SEEN: Final = 4 * len(SHARES) + 2


@cache
def corner_choices(size: int, most: int) -> tuple[Int[np.ndarray, "c 2"], Int[np.ndarray, "c 4"]]:
    """Return distinct choices of corners `(i0, m)`, `m <= n`, of a boundary of `size` nodes, and the four nodes.

    All of them, or where they are more than `most`, those for evenly spaced values of m.
    """
    half = size // 2
    values = np.unique(np.linspace(1, half // 2, min(half // 2, max(2, most // half))).round().astype(np.int64))
    i0, m = (part.ravel() for part in np.meshgrid(np.arange(half), values, indexing="ij"))
    keep = (2 * m < half) | (i0 < m)
    i0, m = i0[keep], m[keep]
    start = np.stack([0 * m, m, 0 * m + half, m + half], axis=1)
    return np.stack([i0, m], axis=1), (i0[:, None] + start) % size


def views(nodes: Float[np.ndarray, "b l 2"]) -> Float[np.ndarray, "b l s"]:
    """Return what each node of domains of unit scale sees."""
    z = nodes[..., 0] + 1j * nodes[..., 1]
    size = z.shape[1]
    tangent = np.roll(z, -1, axis=1) - np.roll(z, 1, axis=1)
    spacing = np.abs(tangent) / 2
    tangent = tangent / np.abs(tangent)
    steps = np.maximum(1, np.round(np.array(SHARES) * size).astype(np.int64))
    index = np.arange(size)[:, None] + np.concatenate([steps, -steps])
    local = (z[:, index % size] - z[..., None]) / tangent[..., None]
    extras = np.stack([np.log(spacing * size / 8), np.full(spacing.shape, np.log(size / 100))], axis=-1)
    return np.concatenate([local.real, local.imag, extras], axis=-1)


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
            nn.Linear(SEEN, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 3 * pooled)
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
