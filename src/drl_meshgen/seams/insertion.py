"""Cutting a mesh open along closed curves, one after the other."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from drl_meshgen.cleanup.refine import split_edges
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.cutgraph import corners_left_of, trace
from drl_meshgen.mesh.splitting import split_crossed
from drl_meshgen.seams.levels import EdgeCurve
from drl_meshgen.seams.loops import Loop, edge_ids

Sides = tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]


@dataclass(frozen=True, eq=False)
class Incision:
    """A mesh on its way open. `parent (f,)` is the first mesh's triangle; vertices keep their ids from step to step.

    `sides` are the vertices on the left and on the right of each cut so far.
    """

    mesh: TriMesh
    parent: Int[np.ndarray, " f"]
    sides: tuple[Sides, ...]

    @staticmethod
    def none(mesh: TriMesh) -> "Incision":
        """Return the mesh before the first cut."""
        return Incision(mesh, np.arange(len(mesh.triangles)), ())

    def along(self, loop: Loop) -> "Incision":
        """Cut along a loop of inner edges: its vertices stay with the left side, the right side gets new ones."""
        tri = self.mesh.triangles
        new = np.full(len(self.mesh.vertices), -1)
        new[loop] = len(self.mesh.vertices) + np.arange(len(loop))
        right = (new[tri] >= 0) & ~corners_left_of(self.mesh.topology, loop, closed=True)
        mesh = TriMesh(np.vstack([self.mesh.vertices, self.mesh.vertices[loop]]), np.where(right, new[tri], tri))
        return Incision(mesh, self.parent, (*self.sides, (loop, new[loop])))

    def across(self, curve: EdgeCurve) -> "Incision":
        """Cut along a closed curve across edges."""
        split = split_crossed(self.mesh, curve.crossed, curve.share)
        (loop,) = trace(split.chords)
        return Incision(split.mesh, self.parent[split.parent], self.sides).along(loop)

    def split(self, marked: Bool[np.ndarray, " e"], loops: list[Loop]) -> tuple["Incision", list[Loop]]:
        """Split inner edges at their midpoints; also return the same loops after it."""
        topology = self.mesh.topology
        parts = 1 + marked[topology.face_edges].sum(axis=1)
        middle = np.where(marked, len(self.mesh.vertices) + np.cumsum(marked) - 1, -1)
        after = []
        for loop in loops:
            both = np.c_[loop, middle[edge_ids(topology, np.c_[loop, np.roll(loop, -1)])]].ravel()
            after.append(both[both >= 0])
        return replace(self, mesh=split_edges(self.mesh, marked), parent=np.repeat(self.parent, parts)), after

    def refined(self, near: Bool[np.ndarray, " v"], loops: list[Loop]) -> tuple["Incision", list[Loop]]:
        """Split the inner edges of the triangles at some vertices, see `split`; boundaries and cuts stay."""
        topology = self.mesh.topology
        marked = np.zeros(len(topology.edges), bool)
        marked[topology.face_edges[near[self.mesh.triangles].any(axis=1)]] = True
        return self.split(marked & (topology.edge_count == 2), loops)
