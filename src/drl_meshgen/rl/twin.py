"""The reward of `templates.score` once more in PyTorch, so that policies learn by its gradient; equal on valid meshes.

Folded quads have no Jacobian ratio, so nothing pulls them back but `validity_penalty`.
"""

import numpy as np
import torch
from jaxtyping import Float, Int

from drl_meshgen.templates.score import LEAST_JACOBIAN, PENALTY, Weights


def _corner_edges(points: Float[torch.Tensor, "*b p 2"], quads: Int[torch.Tensor, "m 4"]) -> tuple:
    corner = points[..., quads, :]
    ahead = torch.roll(corner, -1, dims=-2) - corner
    return ahead, -torch.roll(ahead, 1, dims=-2)


def _cross(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def reward(
    points: Float[torch.Tensor, "*b p 2"],
    quads: Int[torch.Tensor, "m 4"],
    share: Float[torch.Tensor, "*b m"] | None = None,
    weights: Weights | None = None,
) -> Float[torch.Tensor, "*b"]:
    """Return the reward of meshes that keep their boundary nodes (eqs. 11-13, 15), with a gradient.

    `share` weighs the quads, for coarse meshes that stand for finer ones; it sums to 1.
    """
    w = weights or Weights()
    ahead, behind = _corner_edges(points, quads)
    jacobian = _cross(ahead, behind)
    theta = torch.atan2(jacobian, (ahead * behind).sum(dim=-1))
    defect = (np.pi / 2 - torch.where(theta < 0, theta + 2 * np.pi, theta)).abs().amax(dim=-1)
    low, high = jacobian.amin(dim=-1), jacobian.amax(dim=-1)
    ratio = torch.where(low > 0, low / torch.where(high > 0, high, 1.0), 0.0)
    shape = w.orthogonality * (1 - 2 / np.pi * defect) + w.jacobian * ratio
    return w.quality * (shape.mean(dim=-1) if share is None else (share * shape).sum(dim=-1))


def validity_penalty(
    points: Float[torch.Tensor, "*b p 2"],
    quads: Int[torch.Tensor, "m 4"],
    share: Float[torch.Tensor, "*b m"] | None = None,
) -> Float[torch.Tensor, "*b"]:
    """Return `templates.score.validity_penalty`, with a gradient; `share` as in `reward`."""
    ahead, behind = _corner_edges(points, quads)
    side = torch.linalg.vector_norm(ahead, dim=-1).mean(dim=-1)
    lack = torch.relu(LEAST_JACOBIAN - _cross(ahead, behind).amin(dim=-1) / side**2)
    return PENALTY * (lack.mean(dim=-1) if share is None else (share * lack).sum(dim=-1))
