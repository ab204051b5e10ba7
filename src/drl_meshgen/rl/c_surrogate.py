"""Coarse C-type meshes of many domains at once, linear in their controls and differentiable in PyTorch.

Like `surrogate`: every block has the same number of cells, whatever the counts, and what its cells stand for enters as
their share in the reward.
"""

from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Int

from drl_meshgen.rl.c_scene import CELLS, COUNTS
from drl_meshgen.templates.c_type import EDGES, ENDS, RIM, CCounts, layout, positions
from drl_meshgen.templates.mesh import grid_quads


class CSurrogate:
    """The coarse mesh: `divisions` x `divisions` cells in each of the nine blocks."""

    def __init__(self, divisions: int = 4) -> None:
        """Set up the matrix from controls to nodes."""
        self.divisions = divisions
        self._plan = layout(0, CCounts(*[divisions] * len(COUNTS)))
        ends = np.cumsum([0, len(RIM) * divisions, 4, 2 * len(EDGES)])
        rim, singular, bulge = (np.eye(ends[-1])[a:b] for a, b in pairwise(ends))
        parts = [np.linspace(0, 1, divisions + 1)] * len(RIM)
        offset = bulge.reshape(len(EDGES), 2, -1)
        self.matrix = torch.as_tensor(positions(rim, singular, offset, self._plan, parts))

    @cached_property
    def quads(self) -> Int[torch.Tensor, "m 4"]:
        """Quads, block after block."""
        return torch.as_tensor(grid_quads(self._plan.grids))

    def points(
        self, rim: Float[torch.Tensor, "b r 2"], singular: Float[torch.Tensor, "b 4 2"], bulges: torch.Tensor
    ) -> Float[torch.Tensor, "b p 2"]:
        """Return the nodes; `rim` as `part_samples` gives it, a sample a cell, all else as in `CParameters`."""
        vertex = torch.cat([rim[:, :: self.divisions], singular], dim=1)
        chord = vertex[:, ENDS[:, 1]] - vertex[:, ENDS[:, 0]]
        normal = torch.stack([-chord[..., 1], chord[..., 0]], dim=-1)
        offset = (bulges[..., None] * normal[:, :, None]).flatten(1, 2)
        return self.matrix @ torch.cat([rim, singular, offset], dim=1)

    def share(self, counts: Int[torch.Tensor, "b 6"]) -> Float[torch.Tensor, "b q"]:
        """Return the share that each coarse quad has in a mesh with those counts; each row sums to 1."""
        cells = counts[:, CELLS].prod(dim=2).to(self.matrix.dtype)
        return torch.repeat_interleave(cells / cells.sum(dim=1, keepdim=True), self.divisions**2, dim=1) / (
            self.divisions**2
        )
