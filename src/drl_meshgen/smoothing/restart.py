"""Other places to start from where derivatives lead nowhere: nodes brought to the middle of their neighbours."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState

STRAY = 3.0
"""A node further from the median of its neighbours than this many of their median edges is out of place."""
SHARE = 0.7
"""Share of the way to the mean of its neighbours that a node goes in one averaging sweep."""


def _neighbours(mesh: QuadMesh) -> Int[np.ndarray, "n w"]:
    """Neighbours of each node along edges; missing ones are the node itself."""
    edges, n = mesh.topology.edges, len(mesh.points)
    tail = np.concatenate([edges[:, 0], edges[:, 1]])
    head = np.concatenate([edges[:, 1], edges[:, 0]])
    order = np.argsort(tail, kind="stable")
    tail, head = tail[order], head[order]
    place = np.arange(len(tail)) - np.searchsorted(tail, tail)
    table = np.repeat(np.arange(n)[:, None], int(place.max()) + 1, axis=1)
    table[tail, place] = head
    return table


def settled(space: NodeSpace, state: NodeState) -> NodeState:
    """Return the state with stray inner nodes on the surface nearest to the median of their neighbours."""
    table, free = _neighbours(space.mesh), space.free
    around = np.where((table == np.arange(len(table))[:, None])[..., None], np.nan, state.points[table])
    median = np.nanmedian(around, axis=1)
    edges = space.mesh.topology.edges
    length = np.linalg.norm(state.points[edges[:, 1]] - state.points[edges[:, 0]], axis=1)
    stray = free & (np.linalg.norm(state.points - median, axis=1) > STRAY * np.median(length))
    if not stray.any():
        return state
    surface, triangle, weights = space.walker.surface, state.triangle.copy(), state.weights.copy()
    _, triangle[stray], points = TriangleSearch(surface.corners)(median[stray])
    weights[stray] = space.walker.locate(triangle[stray], points)
    return space.thaw(replace(state, triangle=triangle, weights=weights))


def averaged(space: NodeSpace, state: NodeState, sweeps: int) -> NodeState:
    """Return the state after all nodes with tangents went towards the mean of their neighbours, sweep by sweep."""
    table = _neighbours(space.mesh)
    other = table != np.arange(len(table))[:, None]
    count = np.maximum(other.sum(axis=1), 1)
    for _ in range(sweeps):
        pull = (state.points[table] - state.points[:, None]).sum(axis=1) / count[:, None]
        step: Float[np.ndarray, "n 2"] = SHARE * np.einsum("kni,ni->nk", state.tangents, pull)
        state = space.moved(state, step)
    return state
