"""Mesh lines of a quad mesh and the patches its separatrices cut it into."""

import numpy as np
from jaxtyping import Bool, Int

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.mesh.topology import graph_components


def straight_pairs(mesh: QuadMesh) -> Int[np.ndarray, "p 2"]:
    """Return the edge pairs that follow each other along a mesh line through an interior node of valence 4.

    Seen from an edge entering such a node, the line goes on with the edge that has one quad on either side in between:
    side `s` of a quad, then side `s + 1`, then across it, then the next side again. Each pair is listed once.
    """
    t = mesh.topology
    regular = t.used & ~t.on_boundary & (t.valence == 4)
    face, side = np.divmod(np.arange(4 * len(mesh.quads)), 4)
    turn = (side + 1) % 4
    across = t.neighbours[face, turn]
    ok = (across >= 0) & regular[mesh.quads[face, turn]]
    face, side, turn, across = face[ok], side[ok], turn[ok], across[ok]
    edge = t.face_edges[face, turn]
    entry = (t.face_edges[across] == edge[:, None]).argmax(axis=1)
    pairs = np.c_[t.face_edges[face, side], t.face_edges[across, (entry + 1) % 4]]
    return np.unique(np.sort(pairs, axis=1), axis=0)


def separatrix_edges(mesh: QuadMesh) -> Bool[np.ndarray, " e"]:
    """Return which interior edges lie on a mesh line that starts or ends in a special node.

    Special are irregular interior nodes and boundary nodes of valence other than 2 and 3. Lines end there, at the
    boundary, or close up.
    """
    t = mesh.topology
    special = mesh.irregular | (t.on_boundary & (t.valence != 2) & (t.valence != 3))
    interior = t.edge_count > 1
    line = graph_components(straight_pairs(mesh), len(t.edges))
    cut = np.zeros(len(t.edges), bool)
    cut[line[interior & special[t.edges].any(axis=1)]] = True
    return cut[line] & interior


def base_complex(mesh: QuadMesh) -> Int[np.ndarray, " m"]:
    """Return the patch of each quad: the mesh cut along all its separatrices. Manifold, oriented meshes only."""
    t = mesh.topology
    joined = (t.edge_count == 2) & ~separatrix_edges(mesh)
    return graph_components(t.edge_faces[joined], len(mesh.quads))
