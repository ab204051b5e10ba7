"""Nodes of a quad mesh that live on a surface: where they are, which ways they may go, and how they get there."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.smoothing.boundary import BoundaryTrack
from drl_meshgen.smoothing.walk import SurfaceWalker

MIN_GAP = 0.05
"""Boundary nodes that start closer than this share of the mean spacing, or in the wrong order, are spread."""
MAX_APPROACH = 0.4
"""Largest share of the gap to its neighbour that a boundary node may cross in one step."""


@dataclass(frozen=True, eq=False)
class NodeState:
    """Positions of all nodes with what is needed to move on: all arrays are per node."""

    triangle: Int[np.ndarray, " n"]
    weights: Float[np.ndarray, "n 3"]
    s: Float[np.ndarray, " b"]
    """Coordinate along the surface boundary of each sliding node (see `BoundaryTrack`)."""
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    tangents: Float[np.ndarray, "2 n 3"]
    """Directions the two unknowns of a node stand for; zero where a node has fewer."""


class NodeSpace:
    """The unknowns of a mesh on a surface: two tangential ones inside, one along the boundary, none where fixed."""

    def __init__(self, surface: TriMesh, mesh: QuadMesh, fixed: Bool[np.ndarray, " n"] | None = None) -> None:
        self.walker = SurfaceWalker(surface)
        self.track = BoundaryTrack(surface)
        self.mesh = mesh
        self.fixed = np.zeros(len(mesh.points), bool) if fixed is None else np.asarray(fixed, bool)
        loops = mesh.topology.loops
        if len(loops) > len(self.track.length):
            defect = f"the mesh has {len(loops)} boundary loops, the surface {len(self.track.length)}"
            raise InputError("quad mesh", defect)
        self.sliding = np.concatenate([*loops, np.empty(0, np.int64)])
        sizes = np.array([len(loop) for loop in loops], np.int64)
        first = np.cumsum(sizes) - sizes
        ends = np.repeat(first + sizes, sizes)
        self._mesh_loop = np.repeat(np.arange(len(loops)), sizes)
        following = np.arange(1, len(self.sliding) + 1)
        self._next = np.where(following == ends, np.repeat(first, sizes), following)
        self._previous = np.empty_like(self._next)
        self._previous[self._next] = np.arange(len(self._next))
        self._loop = np.zeros(len(self.sliding), np.int64)
        self._slot = np.full(len(mesh.points), -1)
        self._slot[self.sliding] = np.arange(len(self.sliding))

    def start(self, triangle: Int[np.ndarray, " n"]) -> NodeState:
        """State at the mesh's points, each put into its triangle, boundary nodes onto the nearest boundary loop."""
        points = self.mesh.points
        weights = self.walker.locate(triangle, points)
        s = np.empty(0)
        if self.sliding.size:
            segment, s = self.track.project(points[self.sliding])
            near = self.track.loop[segment]
            for k in range(self._mesh_loop[-1] + 1):
                mine = self._mesh_loop == k
                loop = np.bincount(near[mine]).argmax()
                self._loop[mine] = loop
                s[mine] = self._spread(int(loop), s[mine], near[mine] == loop)
        return self._state(triangle.copy(), weights, s)

    def _spread(self, loop: int, s: Float[np.ndarray, " k"], known: Bool[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Coordinates of one mesh loop in strictly increasing order, changed only where they are not."""
        length, count = self.track.length[loop], len(s)
        gap = np.mod(np.roll(s, -1) - s, length)
        in_order = known.all() and abs(gap.sum() - length) < 1e-6 * length and gap.min() > MIN_GAP * length / count
        if in_order:
            return s
        if abs(gap.sum() - length) > 0.5 * length or not known.all():
            # somewhere a node lies behind its predecessor: such gaps are nearly a whole turn
            gap = np.where((gap > 0.5 * length) | ~known | ~np.roll(known, -1), 0.0, gap)
        gap = np.maximum(gap, MIN_GAP * length / count)
        gap *= length / gap.sum()
        first = int(np.argmax(known))
        turned = np.r_[0.0, np.cumsum(np.roll(gap, -first))[:-1]]
        fixed_first = self.track.wrap(np.full(count, loop), s[first] + turned)
        return np.roll(fixed_first, first)

    def _tangents(
        self, normals: Float[np.ndarray, "k 3"], nodes: Int[np.ndarray, " k"], direction: Float[np.ndarray, "b 3"]
    ) -> Float[np.ndarray, "2 k 3"]:
        tangents = tangent_frame(normals)
        slot = self._slot[nodes]
        sliding = slot >= 0
        tangents[0, sliding], tangents[1, sliding] = direction[slot[sliding]], 0.0
        tangents[:, self.fixed[nodes]] = 0.0
        return tangents

    def _state(
        self, triangle: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"], s: Float[np.ndarray, " b"]
    ) -> NodeState:
        direction = np.empty((0, 3))
        if self.sliding.size:
            triangle[self.sliding], weights[self.sliding], direction = self.track.locate(self._loop, s)
        points = self.walker.positions(triangle, weights)
        points[self.fixed] = self.mesh.points[self.fixed]
        normals = self.walker.normals(triangle, weights)
        return NodeState(
            triangle, weights, s, points, normals, self._tangents(normals, np.arange(len(points)), direction)
        )

    def freeze(self, state: NodeState, moving: Bool[np.ndarray, " n"]) -> NodeState:
        """Return the state with the tangents of all nodes but the moving ones set to zero: they stay for good."""
        return replace(state, tangents=state.tangents * moving[:, None])

    def thaw(self, state: NodeState) -> NodeState:
        """Undo `freeze`."""
        return self._state(state.triangle.copy(), state.weights.copy(), state.s)

    def mixed(self, old: NodeState, new: NodeState, take: Bool[np.ndarray, " n"]) -> NodeState:
        """Return the state that has the chosen nodes where `new` has them and the others where `old` has them."""
        chosen = take[:, None]
        return NodeState(
            np.where(take, new.triangle, old.triangle),
            np.where(chosen, new.weights, old.weights),
            np.where(take[self.sliding], new.s, old.s),
            np.where(chosen, new.points, old.points),
            np.where(chosen, new.normals, old.normals),
            np.where(chosen, new.tangents, old.tangents),
        )

    def moved(self, state: NodeState, step: Float[np.ndarray, "n 2"]) -> NodeState:
        """Return the state after moving each node by `step` in units of its tangents."""
        step = np.where(state.tangents.any(axis=2).T, step, 0.0)
        going = np.nonzero(step.any(axis=1))[0]
        displacement = np.einsum("kni,nk->ni", state.tangents[:, going], step[going])
        triangle, weights, s = state.triangle.copy(), state.weights.copy(), state.s
        inner = self._slot[going] < 0
        walking = going[inner]
        triangle[walking], weights[walking] = self.walker.walk(triangle[walking], weights[walking], displacement[inner])
        direction = np.empty((0, 3))
        if not inner.all():
            gap = np.mod(s[self._next] - s, self.track.length[self._loop])
            slide = np.clip(step[self.sliding, 0], -MAX_APPROACH * gap[self._previous], MAX_APPROACH * gap)
            s = self.track.wrap(self._loop, s + slide)
            on_track, at, direction = self.track.locate(self._loop, s)
            slots = self._slot[going[~inner]]
            triangle[going[~inner]], weights[going[~inner]] = on_track[slots], at[slots]
        points, normals, tangents = state.points.copy(), state.normals.copy(), state.tangents.copy()
        points[going] = self.walker.positions(triangle[going], weights[going])
        normals[going] = self.walker.normals(triangle[going], weights[going])
        tangents[:, going] = self._tangents(normals[going], going, direction)
        return NodeState(triangle, weights, s, points, normals, tangents)


def tangent_frame(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 n 3"]:
    """Two unit vectors orthogonal to each unit normal (Duff et al., JCGT 6(1), 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([first, second])
