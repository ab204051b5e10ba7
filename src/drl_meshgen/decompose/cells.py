"""Cells of a junction: the rings that its spine leaves, one per loop, with charts."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.spine import Spine
from drl_meshgen.lift.harmonic import RingChart, ring_chart
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.cutgraph import corner_classes
from drl_meshgen.mesh.topology import Topology

#: Neighbouring nodes of a curve start at least this share of the mean spacing apart.
LEAST_GAP = 0.5


@dataclass(frozen=True, eq=False)
class Ring:
    """A ring of the surface with its chart; `h` is 0 on `inner` and 1 on `outer`.

    `inner` and `outer` are vertices of `mesh` in the direction of increasing theta; `origin (v,)` maps vertices of
    `mesh` to vertices of the cut surface (-1 for those that refinement made).
    """

    mesh: TriMesh
    origin: Int[np.ndarray, " v"]
    inner: Int[np.ndarray, " a"]
    outer: Int[np.ndarray, " b"]
    chart: RingChart

    def unwrapped(self, loop: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Theta along `inner` or `outer`, made increasing over one period."""
        theta = self.chart.theta[loop]
        step = np.diff(np.r_[theta, theta[0]])
        step -= np.round(step - 1 / len(loop))
        step = np.maximum(step, 1e-9)
        return theta[0] + np.r_[0.0, np.cumsum(step[:-1])] / step.sum()


@dataclass(frozen=True, eq=False)
class Cell:
    """Ring of one loop. `sides` lists the spine edges along `outer` as (edge, forward) in increasing theta.

    `starts (s,)` is the index into `ring.outer` where each side begins.
    """

    ring: Ring
    sides: tuple[tuple[int, bool], ...]
    starts: Int[np.ndarray, " s"]

    @property
    def theta_shares(self) -> Float[np.ndarray, " s"]:
        """Share of the period of theta that each side takes."""
        at = self.ring.unwrapped(self.ring.outer)[self.starts]
        return np.diff(np.r_[at, at[0] + 1])

    def outer_theta(self, counts: Int[np.ndarray, " e"]) -> Float[np.ndarray, " n"]:
        """Theta of nodes along the outer loop, from its first side on, equally spaced on every graph edge."""
        ring = self.ring
        theta = ring.unwrapped(ring.outer)
        closed = np.r_[theta, theta[0] + 1]
        vertices = np.r_[ring.outer, ring.outer[0]]
        bounds = np.r_[self.starts, self.starts[0] + len(ring.outer)]
        out = []
        for (edge, _), a, b in zip(self.sides, bounds, bounds[1:], strict=False):
            span = np.arange(a, b + 1)
            angle = closed[span % len(ring.outer)] + span // len(ring.outer)
            p = ring.mesh.vertices[vertices[span % len(ring.outer)]]
            length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]
            out.append(np.interp(np.linspace(0, length[-1], counts[edge] + 1)[:-1], length, angle))
        return np.concatenate(out)


def spread(theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Blend increasing angles of period 1 with equal spacing, just enough to keep `LEAST_GAP` between neighbours."""
    n = len(theta)
    gap = np.diff(np.r_[theta, theta[0] + 1])
    uniform = np.arange(n) / n
    uniform = uniform + (theta - uniform).mean()
    tight = gap.min() * n
    share = 0.0 if tight >= LEAST_GAP else (LEAST_GAP - tight) / (1 - tight)
    return (1 - share) * theta + share * uniform


def submesh(mesh: TriMesh, faces: Int[np.ndarray, " f"]) -> tuple[TriMesh, Int[np.ndarray, " v"]]:
    """Return the triangles `faces` as a mesh of their own and the ids of its vertices."""
    ids, local = np.unique(mesh.triangles[faces], return_inverse=True)
    return TriMesh(mesh.vertices[ids], local.reshape(-1, 3)), ids


def ring_between(mesh: TriMesh, origin: Int[np.ndarray, " v"], inner_vertices: Int[np.ndarray, " n"]) -> Ring | None:
    """Chart a mesh that should be a ring whose first loop passes through `inner_vertices` (ids as in `origin`)."""
    topology = mesh.topology
    loops = topology.loops
    if len(loops) != 2 or topology.euler != 0:
        return None
    on_inner = [bool(np.isin(origin[loop], inner_vertices).all()) for loop in loops]
    if sum(on_inner) != 1:
        return None
    inner, outer = (loops[0], loops[1]) if on_inner[0] else (loops[1], loops[0])
    outer = np.roll(outer[::-1], 1)  # the mesh is on the left of its loops: theta runs the other way round there
    return Ring(mesh, origin, inner, outer, ring_chart(mesh, inner, outer))


def opened(mesh: TriMesh, flags: np.ndarray) -> tuple[TriMesh, Int[np.ndarray, " w"], int, Int[np.ndarray, " f"]]:
    """Open `mesh` along flagged edges: the mesh, old ids of its vertices, number of components, component per face."""
    classes = corner_classes(mesh.topology, flags)
    origin = mesh.triangles.ravel()[np.unique(classes, return_index=True)[1]]
    n, label = Topology(int(classes.max()) + 1, classes).components
    return TriMesh(mesh.vertices[origin], classes), origin, n, label


def sides_along(ring: Ring, graph: Spine) -> tuple[tuple[tuple[int, bool], ...], Int[np.ndarray, " s"]]:
    """Graph edges along the outer loop of `ring` as (edge, forward), and where on the loop each begins."""
    start_of: dict[tuple[int, int], tuple[int, bool]] = {}
    for e, path in enumerate(graph.paths):
        start_of[int(path[0]), int(path[1])] = (e, True)
        start_of[int(path[-1]), int(path[-2])] = (e, False)
    nodes = set(graph.nodes.tolist())
    rim = ring.origin[ring.outer]
    begins = [k for k, v in enumerate(rim.tolist()) if v in nodes]
    sides = tuple(start_of[int(rim[k]), int(rim[(k + 1) % len(rim)])] for k in begins)
    return sides, np.array(begins, np.int64)


def cells(mesh: TriMesh, graph: Spine, loops: tuple[Int[np.ndarray, " n"], ...]) -> tuple[Cell, ...] | None:
    """One cell per loop, in the order of `loops` (vertex ids of `mesh`).

    None when the spine runs into a loop or leaves anything but rings.
    """
    on_loop = np.zeros(len(mesh.vertices), bool)
    on_loop[np.concatenate(loops)] = True
    if not len(graph.nodes) or on_loop[np.concatenate(graph.paths)].any():
        return None
    whole, origin, n, label = opened(mesh, graph.edge_flags)
    if n != len(loops):
        return None
    found: list[Cell | None] = [None] * len(loops)
    for c in range(n):
        piece, ids = submesh(whole, np.nonzero(label == c)[0])
        touching = [k for k, loop in enumerate(loops) if np.isin(origin[ids], loop).any()]
        if len(touching) != 1:
            return None
        ring = ring_between(piece, origin[ids], loops[touching[0]])
        if ring is None:
            return None
        sides, starts = sides_along(ring, graph)
        if not sides:
            return None
        found[touching[0]] = Cell(ring, sides, starts)
    return None if any(cell is None for cell in found) else tuple(cell for cell in found if cell is not None)
