"""Analytic surfaces and block-structured meshes of them, for tests of what comes after meshing."""

import numpy as np

from drl_meshgen.mesh import BlockMesh, TriMesh


def _sphere(disk):
    """Equal-angle map of the unit disk to the upper hemisphere."""
    r = np.linalg.norm(disk, axis=-1)
    polar = np.minimum(r, 1) * np.pi / 2
    unit = disk / np.maximum(r, 1e-300)[..., None]
    return np.concatenate([np.sin(polar)[..., None] * unit, np.cos(polar)[..., None]], axis=-1)


def hemisphere_ogrid(n=8, rings=6, core=0.5):
    """Return a hemisphere of unit radius in five blocks: a square of `n x n` quads and four around it."""
    t = np.linspace(-1, 1, n + 1)
    square = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1)
    bulge = square * (1 - 0.25 * square[..., ::-1] ** 2) * core / np.sqrt(2) * 4 / 3
    ids = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    points, rim = [bulge.reshape(-1, 2)], np.concatenate([ids[:-1, 0], ids[-1, :-1], ids[:0:-1, -1], ids[0, :0:-1]])
    inner = points[0][rim]
    angle = np.arctan2(inner[0, 1], inner[0, 0]) + 2 * np.pi * np.arange(4 * n) / (4 * n)
    outer = np.c_[np.cos(angle), np.sin(angle)]
    layers = [rim]
    for k in range(1, rings + 1):
        layers.append(len(ids.ravel()) + 4 * n * (k - 1) + np.arange(4 * n))
        points.append(inner + k / rings * (outer - inner))
    ring = np.array(layers)
    grids = [ids] + [np.take(ring, np.arange(b * n, (b + 1) * n + 1), axis=1, mode="wrap") for b in range(4)]
    return BlockMesh(_sphere(np.concatenate(points)), tuple(grids))


def hemisphere(n=24):
    """Return a triangulated unit hemisphere with `10 n^2` triangles or so, finer than its quad mesh."""
    quads = hemisphere_ogrid(n, n).mesh
    q = quads.quads
    return TriMesh(quads.points, np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]]))
