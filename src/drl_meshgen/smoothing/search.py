"""Last resort for folded quads where the surface is too sharp for derivatives: try places, node by node."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.smoothing.nodes import NodeSpace, NodeState
from drl_meshgen.smoothing.verdict import Referee

DIRECTIONS = 8
RADII = (0.6, 0.3, 0.12)
"""Distances tried, in mean lengths of the edges at the node."""
SWEEPS = 6
"""Most sweeps over the nodes around folded quads."""


def search(space: NodeSpace, referee: Referee, state: NodeState) -> NodeState:
    """Return a state with fewer folded quads: each inner node near one tries places around it and takes the best.

    A place is judged by the sum of the squared penalties of the quads at the node (exact orientation).
    """
    mesh = space.mesh
    member, start = incidence(mesh.quads, len(mesh.points))
    free = np.ones(len(mesh.points), bool)
    free[space.sliding] = False
    free[space.fixed] = False
    for sweep in range(SWEEPS):
        folded = ~referee.shape(state, exact=True).valid
        if not folded.any():
            break
        near = np.zeros(len(mesh.points), bool)
        near[mesh.quads[folded]] = True
        for _ in range(sweep // 2):
            near[mesh.quads[near[mesh.quads].any(axis=1)]] = True
        triangle, weights, points = state.triangle.copy(), state.weights.copy(), state.points.copy()
        for node in np.nonzero(near & free)[0]:
            ring = mesh.quads[member[start[node] : start[node + 1]]]
            spots = _places(space, state.tangents[:, node], triangle[node], weights[node], points, ring, node)
            penalty = referee.penalty_of_places(points, ring, int(node), spots[2])
            best = int(np.argmin(penalty))
            triangle[node], weights[node], points[node] = spots[0][best], spots[1][best], spots[2][best]
        normals = space.walker.normals(triangle, weights)
        state = space.thaw(replace(state, triangle=triangle, weights=weights, points=points, normals=normals))
    return state


def incidence(quads: Int[np.ndarray, "m 4"], n: int) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " n1"]]:
    """Quads at each node: those of node `v` are `member[start[v]:start[v + 1]]`."""
    order = np.argsort(quads.ravel(), kind="stable")
    return order // 4, np.r_[0, np.cumsum(np.bincount(quads.ravel(), minlength=n))]


def _places(
    space: NodeSpace,
    tangents: Float[np.ndarray, "2 3"],
    triangle: int,
    weights: Float[np.ndarray, " 3"],
    points: Float[np.ndarray, "n 3"],
    ring: Int[np.ndarray, "q 4"],
    node: int,
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """Triangle, barycentric coordinates and position of the places to try; the first is where the node is."""
    scale = np.linalg.norm(points[ring] - points[node], axis=2).mean()
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    circle = np.cos(angle)[:, None] * tangents[0] + np.sin(angle)[:, None] * tangents[1]
    moves = np.concatenate([np.zeros((1, 3)), *(r * scale * circle for r in RADII)])
    found, at = space.walker.walk(np.full(len(moves), triangle), np.tile(weights, (len(moves), 1)), moves)
    return found, at, space.walker.positions(found, at)

