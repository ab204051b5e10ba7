"""Structural defects: what a block-structured mesh of a surface must not have."""

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.mesh.topology import Topology, graph_components
from drl_meshgen.quality.mixed import Outline


def boundary_loops(topology: Outline) -> int:
    """Return the number of connected pieces of the boundary (also where it is not a simple curve)."""
    ids, local = np.unique(topology.boundary_edges, return_inverse=True)
    return len(np.unique(graph_components(local.reshape(-1, 2), len(ids))))


def pinched_nodes(topology: Topology) -> Int[np.ndarray, " p"]:
    """Return the nodes whose faces form more than one fan."""
    faces = topology.faces
    k = faces.shape[1]
    inner = np.nonzero(topology.edge_count == 2)[0]
    pair = topology.edge_faces[inner]
    ends = topology.edges[inner]
    links = []
    for end in range(2):
        here = [(faces[pair[:, f]] == ends[:, end, None]).argmax(axis=1) + k * pair[:, f] for f in range(2)]
        links.append(np.c_[here[0], here[1]])
    fan = graph_components(np.concatenate(links), faces.size)
    node_of_fan = np.unique(np.c_[faces.ravel(), fan], axis=0)[:, 0]
    return np.nonzero(np.bincount(node_of_fan, minlength=topology.n_vertices) > 1)[0]


def unstructured_blocks(mesh: QuadMesh, block: Int[np.ndarray, " m"]) -> Int[np.ndarray, " k"]:
    """Return the ids of blocks that are not an i x j grid.

    A grid is a disk (one component, Euler characteristic 1, one rim) with four corners of one quad, every other rim
    node in two quads and every inner node in four. All blocks are tested at once on the mesh cut along them.
    """
    ids, part = np.unique(block, return_inverse=True)
    key = part[:, None] * np.int64(len(mesh.points)) + mesh.quads
    nodes, local = np.unique(key, return_inverse=True)
    owner = nodes // len(mesh.points)
    t = Topology(len(nodes), local.reshape(-1, 4))
    n = len(ids)

    def per_block(index: np.ndarray) -> np.ndarray:
        return np.bincount(index, minlength=n)

    edge_owner = owner[t.edges[:, 0]]
    euler = per_block(owner) - per_block(edge_owner) + per_block(part)
    piece = np.unique(np.c_[part, t.components[1]], axis=0)[:, 0]
    rim_ids, rim = np.unique(t.boundary_edges, return_inverse=True)
    loop = np.unique(np.c_[owner[rim_ids], graph_components(rim.reshape(-1, 2), len(rim_ids))], axis=0)[:, 0]
    faces_at = np.bincount(t.faces.ravel(), minlength=len(nodes))
    odd = np.where(t.on_boundary, faces_at > 2, faces_at != 4)
    grid = (per_block(piece) == 1) & (euler == 1) & (per_block(loop) == 1) & (per_block(owner[odd]) == 0)
    return ids[~(grid & (per_block(owner[t.on_boundary & (faces_at == 1)]) == 4))]


def t_junctions(mesh: QuadMesh, block: Int[np.ndarray, " m"]) -> Int[np.ndarray, " k"]:
    """Return the nodes where a corner of a block lies inside a side of another. Manifold, oriented meshes only.

    At an interior node of valence 4 that is where three of its edges lie between blocks. With none, every side of a
    block is a whole side of exactly one other block or on the boundary.
    """
    t = mesh.topology
    pair = np.where(t.edge_count[:, None] == 2, block[t.edge_faces], -1)
    between = np.bincount(t.edges[pair[:, 0] != pair[:, 1]].ravel(), minlength=t.n_vertices)
    return np.nonzero(t.used & ~t.on_boundary & (t.valence == 4) & (between == 3))[0]


def topology_defects(outline: Outline, surface: TriMesh) -> tuple[str, ...]:
    """Return how components, boundary loops and Euler characteristic differ from those of the surface."""
    s = surface.topology
    return tuple(
        f"{name}: mesh {mine}, surface {theirs}"
        for name, mine, theirs in (
            ("components", outline.components[0], s.components[0]),
            ("loops", boundary_loops(outline), boundary_loops(s)),
            ("Euler characteristic", outline.euler, s.euler),
        )
        if mine != theirs
    )


def structural_defects(mesh: QuadMesh, block: Int[np.ndarray, " m"] | None = None) -> tuple[str, ...]:
    """Return one sentence per kind of defect; empty for a sound mesh. Validity is not looked at here."""
    t = mesh.topology
    defects = []
    nonmanifold = int((t.edge_count > 2).sum())
    if nonmanifold:
        defects.append(f"{nonmanifold} non-manifold edges")
    if len(t.misoriented_edges):
        defects.append(f"{len(t.misoriented_edges)} edges between quads of opposite orientation")
    pinched = pinched_nodes(t)
    if len(pinched):
        defects.append(f"{len(pinched)} nodes where the mesh is pinched: {pinched[:8].tolist()}")
    if block is not None:
        bad = unstructured_blocks(mesh, block)
        if len(bad):
            defects.append(f"{len(bad)} blocks are not i x j grids: {bad[:8].tolist()}")
    return tuple(defects)
