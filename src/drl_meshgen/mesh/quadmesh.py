"""Quadrilateral meshes, with and without blocks."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.topology import Topology
from drl_meshgen.mesh.trimesh import frozen


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """Quads with corners in order around each; orientation is that of the meshed surface."""

    points: Float[np.ndarray, "n 3"]
    quads: Int[np.ndarray, "m 4"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        object.__setattr__(self, "quads", frozen(self.quads, np.int64))

    @cached_property
    def topology(self) -> Topology:
        """Edges, neighbours, loops."""
        return Topology(len(self.points), self.quads)

    @cached_property
    def irregular(self) -> np.ndarray:
        """Boolean per node: interior node whose valence is not 4."""
        t = self.topology
        return t.used & ~t.on_boundary & (t.valence != 4)


@dataclass(frozen=True, eq=False)
class BlockMesh:
    """A block-structured mesh: each block is a grid of node ids, shared nodes have one id.

    `grids[b][i, j]` is the node of block `b` at `(i, j)`, shape `(ni + 1, nj + 1)`; i to j turns anti-clockwise
    seen from the surface's normal, so the quad `(i, j)` is `(i, j), (i+1, j), (i+1, j+1), (i, j+1)`.
    """

    points: Float[np.ndarray, "n 3"]
    grids: tuple[Int[np.ndarray, "ni1 nj1"], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        object.__setattr__(self, "grids", tuple(frozen(g, np.int64) for g in self.grids))

    @cached_property
    def _cells(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        quads, block, ii, jj = [], [], [], []
        for b, g in enumerate(self.grids):
            quads.append(np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], axis=-1).reshape(-1, 4))
            i, j = np.indices((g.shape[0] - 1, g.shape[1] - 1))
            block.append(np.full(i.size, b))
            ii.append(i.ravel())
            jj.append(j.ravel())
        return np.concatenate(quads), np.concatenate(block), np.concatenate(ii), np.concatenate(jj)

    @cached_property
    def mesh(self) -> QuadMesh:
        """All quads, block after block, `j` fastest."""
        return QuadMesh(self.points, self._cells[0])

    @property
    def block(self) -> Int[np.ndarray, " m"]:
        """Block of each quad."""
        return self._cells[1]

    @property
    def i(self) -> Int[np.ndarray, " m"]:
        """First index of each quad in its block."""
        return self._cells[2]

    @property
    def j(self) -> Int[np.ndarray, " m"]:
        """Second index of each quad in its block."""
        return self._cells[3]

    def moved(self, points: Float[np.ndarray, "n 3"]) -> "BlockMesh":
        """Return the same blocks with other node positions."""
        return BlockMesh(points, self.grids)
