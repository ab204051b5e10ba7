"""Finishing a template mesh: its interior nodes move by themselves to better quads and smoother lines.

What a policy chooses are a few dozen numbers, so nodes move together; here each has its own place. Boundary nodes and
topology stay. Raised is

    (angle O + ratio J - penalty) + smoothness S

of orthogonality (eq. 11, worst corner), Jacobian ratio (eq. 12) and the penalty near folding of `templates.score`, and
the line smoothness of `quality.metrics`. The first two count the worst corners of a quad and so have edges everywhere;
while climbing, power means over the four corners take their place (`finish_kernel`). Climbing is L-BFGS (Nocedal and
Wright, Numerical Optimization, algorithms 7.4 and 3.5) whose first approximation of the inverse Hessian is that of
the graph Laplacian of the mesh: moving all nodes together is then as easy as moving one.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csc_matrix, diags_array
from scipy.sparse.linalg import SuperLU, splu

from drl_meshgen.quality.base_complex import straight_pairs
from drl_meshgen.rl.finish_kernel import Pairs, line_smoothness, quads_worth
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.score import jacobian_ratio, orthogonality, validity_penalty

ANY_MESH = TypeVar("ANY_MESH", bound=TemplateMesh)

LAYERS = 4
"""Layers to ask a policy for where the mesh is to be finished; fewer are worth more before that, but less even."""
ENOUGH, FLAT = 1e-4, 0.5
"""A step gains at least this share of what the slope promises, and leaves at most this share of the slope."""
TRIED = 12
"""Lengths of a step that are tried."""
FIRST = 0.1
"""The longest way a node goes in the first step tried, in mean edge lengths."""


@dataclass(frozen=True)
class FinishOptions:
    """What is raised, and how long."""

    iterations: int = 100
    """Steps, at most."""
    angle: float = 0.25
    """Weight of orthogonality."""
    ratio: float = 1.1
    """Weight of the Jacobian ratio."""
    smoothness: float = 1.5
    """Weight of the smoothness of mesh lines."""
    sharpness: int = 8
    """Corners of a quad count by the power mean of exponent 2 to this power; the larger, the more the worst alone."""
    rounding: float = 0.02
    """Differences of log lengths below this are rounded off in the smoothness."""
    least: float = 0.05
    """Least corner Jacobian over squared mean side that no quad goes below, unless one was below before: then that."""
    memory: int = 5
    """Steps that are remembered."""


def finished(mesh: ANY_MESH, fixed: int, options: FinishOptions | None = None) -> ANY_MESH:
    """Return the mesh with all but its first `fixed` nodes moved; the mesh itself where that would gain nothing.

    The objective never falls, valid meshes stay valid, and the fixed nodes keep their bits. Turned, shifted and scaled
    meshes are finished alike, to rounding.
    """
    o = options or FinishOptions()
    if fixed >= len(mesh.points) or o.iterations < 1:
        return mesh
    problem = _Problem.of(mesh, fixed, o)
    points = np.concatenate([mesh.points[:fixed], problem.climb(mesh.points[fixed:])])
    gained = problem.objective(points) > problem.objective(mesh.points)
    return replace(mesh, points=points) if gained else mesh


@dataclass(frozen=True, eq=False)
class _Problem:
    """A topology with boundary nodes."""

    boundary: Float[np.ndarray, "l 2"]
    quads: Int[np.ndarray, "m 4"]
    lines: Pairs
    laplacian: SuperLU
    options: FinishOptions

    @classmethod
    def of(cls, mesh: TemplateMesh, fixed: int, options: FinishOptions) -> "_Problem":
        topology = mesh.blocks.mesh.topology
        pairs = straight_pairs(mesh.blocks.mesh)
        pairs = pairs[(topology.edge_count[pairs] > 1).all(axis=1)]
        lines = Pairs(np.ascontiguousarray(topology.edges), np.ascontiguousarray(pairs))
        return cls(
            mesh.points[:fixed],
            np.array(mesh.quads),
            lines,
            _laplacian(topology.edges, len(mesh.points), fixed),
            options,
        )

    def objective(self, points: Float[np.ndarray, "p 2"]) -> float:
        """Return what is raised, without rounding off anything."""
        o, quads = self.options, self.quads
        shape = o.angle * orthogonality(points, quads) + o.ratio * jacobian_ratio(points, quads)
        lines = o.smoothness * line_smoothness(points, self.lines, 0.0, 0.0, np.zeros_like(points))
        return float(shape.mean() - validity_penalty(points, quads) + lines)

    def __call__(self, inner: Float[np.ndarray, "i 2"]) -> tuple[float, Float[np.ndarray, "i 2"], float]:
        """Return the negative smooth objective, its gradient, and the least corner Jacobian over squared mean side."""
        o, points = self.options, np.concatenate([self.boundary, inner])
        slope = np.zeros_like(points)
        value, least = quads_worth(points, self.quads, (o.angle, o.ratio), o.sharpness, slope)
        value += o.smoothness * line_smoothness(points, self.lines, o.rounding, o.smoothness, slope)
        return -value, -slope[len(self.boundary) :], least

    def climb(self, start: Float[np.ndarray, "i 2"]) -> Float[np.ndarray, "i 2"]:
        """Return the nodes where L-BFGS gets from `start`."""
        o, memory = self.options, _Memory(self.options.memory, self.laplacian)
        at, (value, slope, least) = start, self(start)
        ends = np.concatenate([self.boundary, start])[self.lines.edges]
        length = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
        for _ in range(o.iterations):
            way = memory.way(slope)
            if not memory.steps:
                way *= FIRST * length / max(float(np.linalg.norm(way, axis=1).max()), np.finfo(float).tiny)
            found = self._search(at, way, value, slope, min(o.least, least))
            if found is None:
                break
            step, value, after, least = found
            memory.add(step, after - slope)
            at, slope = at + step, after
        return at

    def _search(
        self, at: np.ndarray, way: np.ndarray, value: float, slope: np.ndarray, floor: float
    ) -> tuple[np.ndarray, float, np.ndarray, float] | None:
        """Return a step along `way` with value, gradient and least Jacobian at its end; None where none gains."""
        descent = float((slope * way).sum())
        short, long, length, best = 0.0, np.inf, 1.0, None
        for _ in range(TRIED if descent < 0 else 0):
            step = length * way
            there, after, least = self(at + step)
            if not (least >= floor and there <= value + ENOUGH * length * descent):
                long = length
            else:
                short, best = length, (step, there, after, least)
                if (after * way).sum() >= FLAT * descent:
                    break
            length = 2 * short if long == np.inf else (short + long) / 2
        return best


class _Memory:
    """The last steps of L-BFGS and what they changed in the gradient."""

    def __init__(self, size: int, laplacian: SuperLU) -> None:
        self.size, self.laplacian, self.scale = size, laplacian, 1.0
        self.steps: list[tuple[np.ndarray, np.ndarray, float]] = []

    def add(self, step: np.ndarray, change: np.ndarray) -> None:
        """Remember a step where it says something about curvature."""
        product = float(np.vdot(step, change))
        if product > 0:
            self.steps = [*self.steps, (step, change, product)][-self.size :]
            self.scale = product / float(np.vdot(change, self.laplacian.solve(change)))

    def way(self, slope: np.ndarray) -> np.ndarray:
        """Return the way down (algorithm 7.4)."""
        way, shares = -slope, []
        for step, change, product in reversed(self.steps):
            shares.append(float(np.vdot(step, way)) / product)
            way = way - shares[-1] * change
        way = self.scale * self.laplacian.solve(way)
        for (step, change, product), share in zip(self.steps, reversed(shares), strict=True):
            way += (share - float(np.vdot(change, way)) / product) * step
        return way


def _laplacian(edges: Int[np.ndarray, "e 2"], size: int, fixed: int) -> SuperLU:
    """Return a factor of the graph Laplacian of all but the first nodes."""
    weight = coo_matrix((np.ones(len(edges)), edges.T), (size, size)).tocsr()
    weight = weight + weight.T
    whole = (diags_array(np.asarray(weight.sum(axis=1)).ravel()) - weight).tocsr()
    inner = csc_matrix(whole[fixed:, fixed:])
    return splu(inner, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
