"""Mending bad spots: untangle or optimise the surroundings of bad quads, keep what got better, spot by spot."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.smoothing.energy import QuadEnergy
from drl_meshgen.smoothing.newton import minimise
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState
from drl_meshgen.smoothing.restart import averaged
from drl_meshgen.smoothing.untangle import untangle
from drl_meshgen.smoothing.verdict import Referee

AVERAGING = 4
"""Averaging sweeps for each ring of a patch, so that means reach across it."""
PATIENCE = 2
"""A spot is given up after this many rounds in a row in which no fewer of its quads were folded: one of each kind."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Spots of quads around bad ones and the nodes that move to mend them."""

    energy: QuadEnergy
    moving: Bool[np.ndarray, " n"]
    spot: Int[np.ndarray, " m"]
    """Spot of each quad of the mesh, -1 outside; no two spots share a quad."""


def reach_of(mesh: QuadMesh, points: Float[np.ndarray, "n 3"], share: float) -> Float[np.ndarray, " n"]:
    """Longest step of each node: a share of the mean length of its edges, averaged with that of all edges."""
    edges = mesh.topology.edges
    length = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    total = np.bincount(edges.ravel(), np.repeat(length, 2), minlength=len(points))
    local = total / np.maximum(mesh.topology.valence, 1)
    return 0.5 * share * (local + length.mean())


def patch_around(mesh: QuadMesh, bad: Bool[np.ndarray, " m"], rings: int, whole: QuadEnergy) -> Patch:
    """Nodes within `rings` quads of the bad ones, and all quads at those nodes."""
    quads = mesh.quads
    chosen = bad
    moving = np.zeros(len(mesh.points), bool)
    for _ in range(rings):
        moving[quads[chosen].ravel()] = True
        chosen = moving[quads].any(axis=1)
    ids = np.nonzero(chosen)[0]
    # quads that share a moving node belong to the same spot
    member, corner = np.nonzero(moving[quads[ids]])
    n = len(ids)
    graph = coo_array((np.ones(len(member)), (member, n + quads[ids[member], corner])), (n + len(mesh.points),) * 2)
    spot = np.full(len(quads), -1)
    spot[ids] = np.unique(connected_components(graph, directed=False)[1][:n], return_inverse=True)[1]
    return Patch(QuadEnergy(mesh, whole.options.for_repair(), ids, whole.ideal, whole.sizes), moving, spot)


def keep_better(space: NodeSpace, referee: Referee, patch: Patch, old: NodeState, new: NodeState) -> NodeState:
    """Return the state that has `new` in the spots it improves and `old` elsewhere; `old` itself if there are none."""
    before, after = referee.penalties(old), referee.penalties(new)
    inside = patch.spot >= 0
    gain = np.bincount(patch.spot[inside], (before - after)[inside])
    better = np.zeros(len(before), bool)
    better[inside] = gain[patch.spot[inside]] > 0
    take = np.zeros(len(old.points), bool)
    take[space.mesh.quads[better].ravel()] = True
    return space.mixed(old, new, take & patch.moving) if better.any() else old


def unfold(
    space: NodeSpace,
    whole: QuadEnergy,
    referee: Referee,
    state: NodeState,
    idle: Int[np.ndarray, " m"],
) -> NodeState:
    """Untangle around folded quads in growing patches, from where nodes are and from the means of their neighbours.

    `idle` counts the rounds in a row that were no use to the spot that each quad was in, and is carried on in place.
    """
    options, mesh = whole.options, space.mesh
    folded = ~whole.shape(state).valid
    for round_ in range(2 * options.unfold_rounds):
        chosen = folded & (idle < PATIENCE)
        if not chosen.any():
            break
        rings = options.repair_rings + round_
        patch = patch_around(mesh, chosen, rings, whole)
        reach = reach_of(mesh, state.points, 2 * options.step_limit)
        start = space.freeze(state, patch.moving)
        if round_ % 2:
            start = averaged(space, start, AVERAGING * rings)
        tried = space.thaw(untangle(space, patch.energy, start, reach))
        state = keep_better(space, referee, patch, state, tried)
        before, folded = folded, ~whole.shape(state).valid
        inside = patch.spot >= 0
        fewer = np.bincount(patch.spot[inside], before[inside].astype(float) - folded[inside]) > 0
        idle[inside] = np.where(fewer[patch.spot[inside]], 0, idle[inside] + 1)
    return state


def repair(
    space: NodeSpace,
    whole: QuadEnergy,
    referee: Referee,
    state: NodeState,
    rings: int,
) -> NodeState:
    """Optimise the surroundings of quads beyond the repair limits, with hinge penalties and the rest frozen."""
    options, mesh = whole.options, space.mesh
    patch = patch_around(mesh, referee.bad(state), rings, whole)
    reach = reach_of(mesh, state.points, options.step_limit)
    local = patch.energy.with_hinge(options.repair_hinge)
    tried = minimise(space, local, space.freeze(state, patch.moving), reach, steps=options.repair_steps)
    return keep_better(space, referee, patch, state, space.thaw(tried))
