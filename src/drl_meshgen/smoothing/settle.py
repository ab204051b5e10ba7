"""Nodes for bumps and creases that quads bridge: where the surface is far from the mesh, a node goes there."""

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.deviation import as_triangles
from drl_meshgen.smoothing.energy import QuadEnergy
from drl_meshgen.smoothing.newton import minimise
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState
from drl_meshgen.smoothing.patches import Patch, patch_around, reach_of
from drl_meshgen.smoothing.verdict import Referee

#: Nodes within this many of their mean edge lengths of one that was chosen are not chosen in the same round.
APART = 3.0
#: Steps in which a chosen node walks to its place.
WALKS = 3
#: Rings of quads around a chosen node that make room for it.
RINGS = 4
#: Squared degrees beyond the wanted limits that a quad of a spot may have afterwards, if none there had more before.
SLACK = 9.0
#: Share by which the largest distance in a spot must fall.
LEAST_GAIN = 0.05


def settle(space: NodeSpace, whole: QuadEnergy, referee: Referee, state: NodeState) -> NodeState:
    """Move nodes to the places of the surface that are farther than the option `deviation` from the mesh.

    The place of largest distance in each neighbourhood gets the nearest node, which stays there while those around it
    are optimised. Kept spot by spot, where the distance falls and no quad gets worse than the worst was.
    """
    samples, tolerance = samples_of(referee.surface), whole.options.deviation * _mean_edge(space.mesh, state)
    for round_ in range(whole.options.settle_rounds):
        distance, quad = distances(space.mesh, state.points, samples)
        far = np.nonzero(distance > tolerance)[0]
        far = far[np.argsort(-distance[far], kind="stable")]
        chosen, goal = _choice(space, state, samples[far], space.mesh.quads[quad[far]], min(round_ % 2, 1))
        if not len(chosen):
            break
        pinned = np.zeros(len(state.points), bool)
        pinned[chosen] = True
        patch = patch_around(space.mesh, np.asarray(pinned[space.mesh.quads].any(axis=1)), RINGS, whole)
        tried = _walked(space, state, chosen, goal)
        held = space.freeze(tried, patch.moving & ~pinned)
        reach = reach_of(space.mesh, state.points, whole.options.step_limit)
        local = patch.energy.with_hinge(whole.options.repair_hinge)
        tried = space.thaw(minimise(space, local, held, reach, steps=whole.options.repair_steps))
        inside = np.nonzero(patch.spot[quad] >= 0)[0]
        after, _ = distances(space.mesh, tried.points, samples[inside])
        closer = _closer(patch.spot[quad[inside]], distance[inside], after)
        new = _kept(space, referee, patch, (state, tried), closer)
        if new is state:
            break
        state = new
    return state


def _mean_edge(mesh: QuadMesh, state: NodeState) -> float:
    ends = state.points[mesh.topology.edges]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def samples_of(surface: TriMesh) -> Float[np.ndarray, "s 3"]:
    """Return vertices and centroids of a surface."""
    return np.concatenate([surface.vertices, surface.corners.mean(axis=1)])


def distances(
    mesh: QuadMesh, points: Float[np.ndarray, "n 3"], samples: Float[np.ndarray, "s 3"]
) -> tuple[Float[np.ndarray, " s"], Int[np.ndarray, " s"]]:
    """Return the distance of each sample from the mesh with nodes at `points`, and the nearest quad."""
    distance, triangle, _ = TriangleSearch(points[as_triangles(mesh)])(samples)
    return distance, triangle % len(mesh.quads)


def _choice(
    space: NodeSpace,
    state: NodeState,
    places: Float[np.ndarray, "k 3"],
    corners: Int[np.ndarray, "k 4"],
    rank: int,
) -> tuple[Int[np.ndarray, " c"], Float[np.ndarray, "c 3"]]:
    """Return nodes and the places they go to, from the first place on.

    `corners` are those of the quad nearest to each place; the nearest of them is taken, or the next by `rank`.
    """
    gap = np.linalg.norm(state.points[corners] - places[:, None], axis=2)
    apart = APART * reach_of(space.mesh, state.points, 1.0)
    free = np.asarray(state.tangents.any(axis=2).all(axis=0))
    gap[~free[corners]] = np.inf
    nearest = np.take_along_axis(corners, np.argsort(gap, axis=1, kind="stable"), axis=1)[:, rank]
    nodes: list[int] = []
    goals = np.empty((0, 3))
    for node, place in zip(nearest.tolist(), places, strict=True):
        if free[node] and (not nodes or np.linalg.norm(goals - place, axis=1).min() >= apart[node]):
            nodes.append(node)
            goals = np.vstack([goals, place])
    return np.array(nodes, np.int64), goals


def _walked(
    space: NodeSpace, state: NodeState, nodes: Int[np.ndarray, " c"], goals: Float[np.ndarray, "c 3"]
) -> NodeState:
    """Return the state with nodes walked towards their goals along the surface."""
    for _ in range(WALKS):
        away = goals - state.points[nodes]
        along = np.einsum("kci,ci->ck", state.tangents[:, nodes], away)
        length = np.linalg.norm(along, axis=1)
        along *= (np.linalg.norm(away, axis=1) / np.maximum(length, np.finfo(float).tiny))[:, None]
        step = np.zeros((len(state.points), 2))
        step[nodes] = along
        state = space.moved(state, step)
    return state


def _closer(
    spot: Int[np.ndarray, " s"], before: Float[np.ndarray, " s"], after: Float[np.ndarray, " s"]
) -> Bool[np.ndarray, " n"]:
    """Return the spots in which the largest distance of a sample falls."""
    worst = np.zeros((2, int(spot.max()) + 1))
    np.maximum.at(worst[0], spot, before)
    np.maximum.at(worst[1], spot, after)
    return worst[1] < (1 - LEAST_GAIN) * worst[0]


def _kept(
    space: NodeSpace,
    referee: Referee,
    patch: Patch,
    states: tuple[NodeState, NodeState],
    closer: Bool[np.ndarray, " n"],
) -> NodeState:
    """Return the new state in the spots that are `closer` and no worse in shape, the old one elsewhere.

    The old one itself if there are no such spots.
    """
    old, new = states
    inside = patch.spot >= 0
    spots = patch.spot[inside]
    worst = np.zeros((2, int(spots.max()) + 1))
    for k, state in enumerate(states):
        np.maximum.at(worst[k], spots, referee.penalties(state)[inside])
    good = np.zeros(worst.shape[1], bool)
    good[: len(closer)] = closer
    good &= worst[1] <= np.maximum(SLACK, worst[0])
    if not good.any():
        return old
    take = np.zeros(len(old.points), bool)
    take[space.mesh.quads[inside & good[patch.spot]].ravel()] = True
    return space.mixed(old, new, take & patch.moving)
