"""Coarse O-type meshes of many domains at once, linear in their controls and differentiable in PyTorch.

All have the same numbers of cells, whatever the domain's L, m, n and k, so one matrix maps boundary samples, singular
points and bulges to nodes. What the cells of each block stand for enters as their share in the reward.

A coarse mesh is bent more per cell, so its reward is lower: by 0.06 at 6 cells a side, 0.02 at 12, less than 0.01 at
20; over domains it ranks as the fine one does (correlations 0.92, 0.97 and 0.98 on ten of Test-Standard).
"""

from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Int

from drl_meshgen.templates.curves import SWELLS, WAVES
from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import EDGES, grids, positions


class Surrogate:
    """The coarse mesh: `divisions` cells along each side, `layers` around the core."""

    def __init__(self, divisions: int = 6, layers: int = 3) -> None:
        """Set up the matrix from controls to nodes."""
        self.divisions, self.layers = divisions, layers
        t = np.linspace(0, 1, divisions + 1)
        ends = np.cumsum([0, 4 * divisions, 4, 2 * EDGES, WAVES * EDGES, 4 * SWELLS])
        rim, singular, bulge, wave, swell = (np.eye(ends[-1])[a:b] for a, b in pairwise(ends))
        matrix = positions(
            rim,
            singular,
            np.concatenate([part.reshape(EDGES, -1, ends[-1]) for part in (bulge, wave)], axis=1),
            corners=(0, divisions, divisions),
            radial=np.linspace(0, 1, layers + 1),
            fractions=(t, t, t, t),
            swells=swell.reshape(4, SWELLS, -1),
        )
        self.matrix = torch.as_tensor(matrix)

    @cached_property
    def quads(self) -> Int[torch.Tensor, "m 4"]:
        """Quads: the core, then the blocks of sides 0-3."""
        return torch.as_tensor(grid_quads(grids(0, self.divisions, self.divisions, self.layers)))

    def points(
        self,
        rim: Float[torch.Tensor, "b r 2"],
        singular: Float[torch.Tensor, "b 4 2"],
        bulges: Float[torch.Tensor, "b 8 2"],
        waves: Float[torch.Tensor, "b 8 2 2"] | None = None,
        swells: Float[torch.Tensor, "b 4 3 2"] | None = None,
    ) -> Float[torch.Tensor, "b p 2"]:
        """Return the nodes; `rim` by `side_samples`, a sample a cell.

        All else is as in `OParameters`, without waves and swells if None.
        """
        start = torch.cat([rim[:, :: self.divisions], singular], dim=1)
        end = torch.cat([singular, torch.roll(singular, -1, dims=1)], dim=1)
        chord = end - start
        normal = torch.stack([-chord[..., 1], chord[..., 0]], dim=-1)
        offset = (bulges[..., None] * normal[:, :, None]).flatten(1, 2)
        controls = [rim, singular, offset]
        if waves is not None and swells is not None:
            controls += [waves.flatten(1, 2), swells.flatten(1, 2)]
        # one product of two matrices; as a batch of them it takes several times as long
        flat = torch.cat(controls, dim=1).transpose(0, 1)
        made = self.matrix[:, : len(flat)] @ flat.flatten(1)
        return made.unflatten(1, flat.shape[1:]).transpose(0, 1)

    def share(
        self, m: Int[torch.Tensor, " b"], n: Int[torch.Tensor, " b"], layers: Int[torch.Tensor, " b"]
    ) -> Float[torch.Tensor, "b q"]:
        """Return the share that each coarse quad has in a mesh with those numbers of cells; each row sums to 1."""
        cells = torch.stack([m * n, m * layers, n * layers, m * layers, n * layers], dim=1).to(self.matrix.dtype)
        outer = self.divisions * self.layers
        coarse = torch.tensor([self.divisions**2, outer, outer, outer, outer])
        return torch.repeat_interleave(cells / cells.sum(dim=1, keepdim=True) / coarse, coarse, dim=1)

    @cached_property
    def _lines(self) -> tuple[Int[torch.Tensor, "t 3"], Int[torch.Tensor, "t 3"], Float[torch.Tensor, " t"]]:
        """Return consecutive nodes of lines, the directions of both edges and across them, and whether a block ends.

        Directions count m, n or k fine cells: 0, 1, 2.
        """
        core, *outer = grids(0, self.divisions, self.divisions, self.layers)
        parts: list[tuple[np.ndarray, ...]] = []

        def add(a: np.ndarray, b: np.ndarray, c: np.ndarray, way: tuple[int, int, int], end: float) -> None:
            nodes = np.stack([a.ravel(), b.ravel(), c.ravel()], axis=1)
            parts.append((nodes, np.tile(way, (a.size, 1)), np.full(a.size, end)))

        add(core[:-2, :], core[1:-1, :], core[2:, :], (0, 0, 1), 0.0)
        add(core[:, :-2], core[:, 1:-1], core[:, 2:], (1, 1, 0), 0.0)
        inward = core[:, 1], core[-2], core[::-1, -2], core[1, ::-1]
        for s, block in enumerate(outer):
            along, following = s % 2, outer[(s + 1) % 4]
            add(block[:-2, 1:], block[1:-1, 1:], block[2:, 1:], (along, along, 2), 0.0)
            add(block[:, :-2], block[:, 1:-1], block[:, 2:], (2, 2, along), 0.0)
            add(block[1:-1, -2], block[1:-1, -1], inward[s][1:-1], (2, 1 - along, along), 1.0)
            add(block[-2, 1:-1], block[-1, 1:-1], following[1, 1:-1], (along, 1 - along, 2), 0.0)
        nodes, ways, ends = (torch.as_tensor(np.concatenate(part)) for part in zip(*parts, strict=True))
        return nodes, ways, ends

    def smoothness(
        self,
        points: Float[torch.Tensor, "b p 2"],
        m: Int[torch.Tensor, " b"],
        n: Int[torch.Tensor, " b"],
        layers: Int[torch.Tensor, " b"],
    ) -> Float[torch.Tensor, " b"]:
        """Return about the mean ratio, at most 1, of consecutive edges along lines of meshes with those cells.

        A coarse edge stands for several fine ones, so its ratio to the next is spread over as many, but where the core
        meets the outer blocks.
        """
        nodes, ways, ends = self._lines
        fine = torch.stack([m / self.divisions, n / self.divisions, layers / self.layers], dim=1).to(points.dtype)
        first, second, across = (fine[:, ways[:, i]] for i in range(3))
        edges = torch.diff(points[:, nodes], dim=2).norm(dim=-1).clamp_min(1e-9)
        lengths = edges[..., 0] / first, edges[..., 1] / second
        spread = torch.where(ends > 0, 1.0, (first + second) / 2).clamp_min(1.0)
        ratio = torch.exp(-(lengths[0].log() - lengths[1].log()).abs() / spread)
        weight = across * torch.where(ends > 0, 1.0, spread)
        return (weight * ratio).sum(dim=1) / weight.sum(dim=1)
