"""Reward less penalty of meshes as one function of nodes in PyTorch, by the compiled kernel and its gradient."""

from typing import Any

import torch

from drl_meshgen.rl.slope import worth_and_slope
from drl_meshgen.templates.score import Weights


class Worth(torch.autograd.Function):
    """`worth_and_slope` for PyTorch: `Worth.apply(points, quads, share, weights)`, double precision."""

    @staticmethod
    def forward(
        ctx: Any, points: torch.Tensor, quads: torch.Tensor, share: torch.Tensor, weights: Weights
    ) -> torch.Tensor:
        """Return the worth of each mesh, (b,)."""
        value, slope = worth_and_slope(points.detach().numpy(), quads.numpy(), share.numpy(), weights)
        ctx.save_for_backward(torch.as_tensor(slope))
        return torch.as_tensor(value)

    @staticmethod
    def backward(ctx: Any, *above: torch.Tensor) -> tuple[torch.Tensor, None, None, None]:
        """Return the gradient in the points."""
        (slope,) = ctx.saved_tensors
        return above[0][:, None, None] * slope, None, None, None
