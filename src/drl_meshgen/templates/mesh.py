"""What a template becomes once its parameters are chosen: plane points and the node grids of its blocks."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import BlockMesh
from drl_meshgen.mesh.trimesh import frozen
from drl_meshgen.templates.score import jacobians


@dataclass(frozen=True, eq=False)
class TemplateMesh:
    """A block-structured plane mesh; the first L points are the domain's boundary nodes in their order.

    `grids` are as in `drl_meshgen.mesh.BlockMesh`.
    """

    points: Float[np.ndarray, "p 2"]
    grids: tuple[Int[np.ndarray, "ni1 nj1"], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        object.__setattr__(self, "grids", tuple(frozen(g, np.int64) for g in self.grids))

    @cached_property
    def quads(self) -> Int[np.ndarray, "m 4"]:
        """All quads, anti-clockwise, block after block."""
        return frozen(grid_quads(self.grids), np.int64)

    @property
    def folded(self) -> np.ndarray:
        """Ids of quads with a corner Jacobian that is not positive."""
        return np.nonzero(~(jacobians(self.points, self.quads) > 0).all(axis=-1))[0]

    @property
    def valid(self) -> bool:
        """Whether every quad has four positive corner Jacobians."""
        return len(self.folded) == 0

    @cached_property
    def blocks(self) -> BlockMesh:
        """The mesh in the plane z = 0, with its topology."""
        return BlockMesh(np.c_[self.points, np.zeros(len(self.points))], self.grids)


def grid_quads(grids: tuple[np.ndarray, ...]) -> Int[np.ndarray, "m 4"]:
    """Return the quads of all grids, `j` fastest within a block."""
    return np.concatenate(
        [np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], axis=-1).reshape(-1, 4) for g in grids]
    )
