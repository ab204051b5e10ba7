"""Midpoint subdivision."""

import numpy as np

from drl_meshgen.mesh import TriMesh


def subdivided(mesh: TriMesh) -> TriMesh:
    """Split each triangle in four at its edge midpoints: old vertices first, then one per edge of `topology.edges`."""
    topology = mesh.topology
    middle = mesh.vertices[topology.edges].mean(axis=1)
    a, b, c = mesh.triangles.T
    ab, bc, ca = (topology.face_edges + len(mesh.vertices)).T
    triangles = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return TriMesh(np.vstack([mesh.vertices, middle]), triangles)


def refined(mesh: TriMesh, at_least: int) -> tuple[TriMesh, int]:
    """Subdivide until the mesh has `at_least` triangles; returns the mesh and the number of rounds."""
    rounds = 0
    while len(mesh.triangles) < at_least:
        mesh, rounds = subdivided(mesh), rounds + 1
    return mesh, rounds
