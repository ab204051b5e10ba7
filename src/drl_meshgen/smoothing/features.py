"""Mesh lines for feature curves: the path of mesh edges that follows each curve best."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from drl_meshgen.mesh import FeatureCurve, QuadMesh
from drl_meshgen.smoothing.curves import CurveTrack
from drl_meshgen.smoothing.nodes import Chain

DISTANCE_WEIGHT = 8.0
"""How much more an edge costs for each squared mean edge length of distance from the curve."""
ANGLE_WEIGHT = 2.0
"""How much more an edge costs that runs across the curve."""
CLOSED_PIECES = 4
"""A closed curve without corners is followed in this many pieces."""
LEAST_GAP = 0.2
"""Nodes of a chain closer along the curve than this share of their mean gap, or out of order, are spread evenly."""


def chains_along(mesh: QuadMesh, track: CurveTrack, features: Sequence[FeatureCurve]) -> tuple[Chain, ...]:
    """Return a chain of mesh nodes for each feature curve that has one; no two chains share more than ends.

    Corners and ends get the nearest nodes; between them nodes follow the shortest path over mesh edges, where edges
    cost more the farther they are from the curve and the more they run across it. Boundary nodes are only ends.
    """
    edges, points = mesh.topology.edges, mesh.points
    tail, head = points[edges[:, 0]], points[edges[:, 1]]
    length = np.linalg.norm(head - tail, axis=1)
    taken, chains = mesh.topology.on_boundary.copy(), []
    for k, feature in enumerate(features):
        curve = track.n_loops + k
        only = np.array([curve])
        _, s, away = track.project(0.5 * (tail + head), only)
        along = track.locate(np.full(len(s), curve), s)[2]
        across = 1 - (np.einsum("ei,ei->e", head - tail, along) / np.maximum(length, np.finfo(float).tiny)) ** 2
        cost = length * (1 + DISTANCE_WEIGHT * (away / length.mean()) ** 2 + ANGLE_WEIGHT * across)
        chain = _chain(mesh, track, (k, feature), cost, taken)
        if chain is not None:
            chains.append(chain)
            taken[chain.nodes] = True
    return tuple(chains)


def _chain(
    mesh: QuadMesh,
    track: CurveTrack,
    numbered: tuple[int, FeatureCurve],
    cost: Float[np.ndarray, " e"],
    taken: np.ndarray,
) -> Chain | None:
    """Return the chain along one curve, None where its nodes coincide or are taken."""
    k, feature = numbered
    anchors = _anchors(track, track.n_loops + k, feature)
    places = track.points(np.full(len(anchors), track.n_loops + k), anchors)
    nearest = [int(np.argmin(((mesh.points - p) ** 2).sum(axis=1))) for p in places]
    ends = [*nearest, nearest[0]] if feature.closed else nearest
    edges, n = mesh.topology.edges, len(mesh.points)
    nodes = [ends[0]]
    for start, goal in pairwise(ends):
        blocked = taken.copy()
        blocked[nodes] = True
        blocked[[start, goal]] = False
        open_ = ~blocked[edges].any(axis=1)
        graph = csr_array((cost[open_], (edges[open_, 0], edges[open_, 1])), (n, n))
        distance, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        if start == goal or not np.isfinite(distance[goal]):
            return None
        path = [goal]
        while path[-1] != start:
            path.append(int(before[path[-1]]))
        nodes += path[-2::-1]
    if feature.closed:
        nodes.pop()
    row = np.array(nodes)
    pinned = np.isin(row, nearest) if len(feature.corners) or not feature.closed else np.zeros(len(row), bool)
    return Chain(k, row, pinned, _spaced(mesh, track, anchors, (row, nearest), feature))


def _anchors(track: CurveTrack, curve: int, feature: FeatureCurve) -> Float[np.ndarray, " a"]:
    """Coordinates of the corners and ends, at least enough of them to know the direction of a closed curve."""
    knots = np.r_[track.knot[track.curve == curve], track.start[curve] + track.length[curve]]
    at = set(np.asarray(feature.corners, np.int64).tolist())
    if not feature.closed:
        at |= {0, len(feature.points) - 1}
    chosen = knots[sorted(at)]
    if feature.closed and len(chosen) < CLOSED_PIECES - 1:
        first = chosen[0] if len(chosen) else track.start[curve]
        steps = first + track.length[curve] * np.arange(CLOSED_PIECES) / CLOSED_PIECES
        chosen = np.sort(track.wrap(np.full(CLOSED_PIECES, curve), steps))
    return chosen


def _spaced(
    mesh: QuadMesh,
    track: CurveTrack,
    anchors: Float[np.ndarray, " a"],
    rows: tuple[Int[np.ndarray, " k"], list[int]],
    feature: FeatureCurve,
) -> Float[np.ndarray, " k"]:
    """Coordinates of the nodes of a chain: nearest places on the curve where in order, else evenly between anchors."""
    row, nearest = rows
    curve = int(np.searchsorted(track.start, anchors[0], side="right") - 1)
    length = track.length[curve]
    at = np.array([int(np.nonzero(row == node)[0][0]) for node in nearest])
    stops, values = at, anchors
    if feature.closed:
        stops, values = np.r_[at, at[0] + len(row)], np.r_[anchors, anchors[0] + length]
    even = np.interp(np.arange(len(row)), stops, values)
    projected = track.project(mesh.points[row], np.array([curve]))[1]
    if feature.closed:  # the nearest place may lie on the other side of the first point
        projected = even + np.mod(projected - even + 0.5 * length, length) - 0.5 * length
    projected[at] = anchors
    gap = np.diff(projected, append=projected[0] + length) if feature.closed else np.diff(projected)
    in_order = gap.min() > LEAST_GAP * length / len(row)
    return track.wrap(np.full(len(row), curve), projected if in_order else even)
