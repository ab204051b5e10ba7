"""Ablation of the reward (paper Table 1, Fig. 10): learners whose boundary nodes may leave the samples.

Where mesh and boundary share their nodes, as in all else here, the fit is exact and its weight says nothing. Here a
mesh may also displace its boundary nodes, by sines along each side, and pays for it by eq. 14.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int

from drl_meshgen.rl.learning import Learner
from drl_meshgen.rl.surrogate import Surrogate
from drl_meshgen.templates.curves import SWELLS, sines
from drl_meshgen.templates.score import Weights, boundary_mse

REWARDS: Final = {
    "quality only": Weights(quality=1.0, fidelity=0.0),
    "fitting only": Weights(quality=0.0, fidelity=1.0),
    "full": Weights(),
}
"""Rewards of Table 1."""
ANGLE_WEIGHTS: Final = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Weights of orthogonality of Fig. 10."""


def displaced(
    nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "2"], rim: Float[np.ndarray, "4 3 2"]
) -> Float[np.ndarray, "l 2"]:
    """Return boundary nodes moved by sines along each side between the corners `(i0, m)`."""
    i0, m = corners
    counts = np.array([m, len(nodes) // 2 - m] * 2)
    moves = [sines(np.arange(count) / count, SWELLS) @ wave for count, wave in zip(counts, rim, strict=True)]
    return nodes + np.roll(np.concatenate(moves), i0, axis=0)


class FreeLearner(Learner):
    """A learner of meshes whose boundary nodes are free; the weights are those of its options."""

    def worth(
        self,
        coarse: Surrogate,
        rim: Float[torch.Tensor, "b r 2"],
        parts: Mapping[str, torch.Tensor],
        share: Float[torch.Tensor, "b q"],
    ) -> Float[torch.Tensor, " b"]:
        """Return the worth of the quads less the misfit of the rim."""
        waves = torch.as_tensor(sines(np.arange(coarse.divisions) / coarse.divisions, SWELLS))
        moved = (waves @ parts["rim"]).flatten(1, 2)
        inner = {name: part for name, part in parts.items() if name != "rim"}
        misfit = moved.square().sum(dim=-1).mean(dim=-1) / self.spacing(rim) ** 2
        return super().worth(coarse, rim + moved, inner, share) - self.options.weights.fidelity * misfit

    def exact(
        self,
        nodes: Float[np.ndarray, "l 2"],
        corners: Int[np.ndarray, "1 2"],
        layers: Int[np.ndarray, "1"],
        parts: Mapping[str, np.ndarray],
    ) -> float:
        """Return the reward of one mesh less its penalty."""
        moved = displaced(nodes, corners[0], parts["rim"][0])
        inner = {name: part for name, part in parts.items() if name != "rim"}
        spacing = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1).mean()
        misfit = boundary_mse(moved, nodes) / spacing**2
        return super().exact(moved, corners, layers, inner) - self.options.weights.fidelity * float(misfit)

    def spacing(self, rim: Float[torch.Tensor, "b r 2"]) -> Float[torch.Tensor, " b"]:
        """Return the mean spacing of a boundary of 100 nodes with these samples."""
        return (torch.roll(rim, -1, dims=1) - rim).norm(dim=-1).sum(dim=1) / 100
