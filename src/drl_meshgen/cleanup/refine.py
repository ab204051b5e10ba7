"""Refinement that keeps the shape: midpoint subdivision, of everything or of chosen edges."""

import numpy as np
from jaxtyping import Bool

from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci.pinches import separating_triangles

_SPLITS = {  # sides split, in order from the corner a: triangles of corners a b c and midpoints ab bc ca (3 4 5)
    (False, False, False): [(0, 1, 2)],
    (True, False, False): [(0, 3, 2), (3, 1, 2)],
    (True, True, False): [(3, 1, 4), (0, 3, 2), (3, 4, 2)],
    (True, True, True): [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
}


def split_edges(mesh: TriMesh, marked: Bool[np.ndarray, " e"]) -> TriMesh:
    """Split the marked edges (of `topology.edges`) at their midpoints and the triangles at them in two to four.

    Old vertices come first, then one per marked edge; the triangles keep their order, each replaced by its parts.
    """
    topology = mesh.topology
    middle = np.where(marked, len(mesh.vertices) + np.cumsum(marked) - 1, -1)
    split = marked[topology.face_edges]
    first = np.where(split.sum(axis=1) == 1, split.argmax(axis=1), (np.argmin(split, axis=1) + 1) % 3)
    first = np.where(split.all(axis=1) | ~split.any(axis=1), 0, first)
    turn = (first[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(mesh.triangles, turn, axis=1)
    nodes = np.c_[corners, middle[np.take_along_axis(topology.face_edges, turn, axis=1)]]
    pieces, order = [], []
    for pattern, triangles in _SPLITS.items():
        chosen = np.nonzero(split.sum(axis=1) == sum(pattern))[0]
        pieces.append(nodes[chosen][:, triangles].reshape(-1, 3))
        order.append(np.repeat(chosen, len(triangles)))
    new = np.concatenate(pieces)[np.argsort(np.concatenate(order), kind="stable")]
    return TriMesh(np.vstack([mesh.vertices, mesh.vertices[topology.edges[marked]].mean(axis=1)]), new)


def subdivided(mesh: TriMesh) -> TriMesh:
    """Split each triangle in four at its edge midpoints."""
    return split_edges(mesh, np.ones(len(mesh.topology.edges), bool))


def refined(mesh: TriMesh, at_least: int) -> tuple[TriMesh, int]:
    """Subdivide each component until it has `at_least` triangles; returns the mesh and the number of rounds."""
    rounds = 0
    while True:
        label = mesh.topology.components[1]
        coarse = (np.bincount(label) < at_least)[label]
        if not coarse.any():
            return mesh, rounds
        marked = np.zeros(len(mesh.topology.edges), bool)
        marked[mesh.topology.face_edges[coarse]] = True
        mesh, rounds = split_edges(mesh, marked), rounds + 1


def widened_necks(mesh: TriMesh, rounds: int = 4) -> tuple[TriMesh, int]:
    """Split the edges of 3-cycles that bound no triangle until none is left or `rounds` are over.

    A limb pinched to a ring of three edges gets one of six; the shape stays. Returns the mesh and the number of
    cycles at the start.
    """
    found = separating_triangles(mesh)
    count = len(found)
    for _ in range(rounds):
        if len(found) == 0:
            break
        n = len(mesh.vertices)
        code = np.sort(np.vstack([found[:, [0, 1]], found[:, [1, 2]], found[:, [0, 2]]]), axis=1) @ (n, 1)
        mesh = split_edges(mesh, np.isin(mesh.topology.edges @ (n, 1), code))
        found = separating_triangles(mesh)
    return mesh, count
