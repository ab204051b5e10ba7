"""Choice of the four corners of an O-type mesh by scoring every choice on a coarse mesh at once."""

from functools import cache

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import grids, positions


@cache
def reference(divisions: int, layers: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the matrix from 4 x divisions boundary points to all points of a coarse O-grid, and its grids.

    Singular points by Tutte's embedding of the coarse grid graph, edges straight, evenly divided.
    """
    size = 4 * divisions
    blocks = grids(0, divisions, divisions, layers)
    quads = grid_quads(blocks)
    total = size * layers + (divisions + 1) ** 2
    pairs = np.unique(np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1), axis=0)
    adjacency = np.zeros((total, total))
    adjacency[pairs[:, 0], pairs[:, 1]] = adjacency[pairs[:, 1], pairs[:, 0]] = 1.0
    laplacian = np.diag(adjacency.sum(axis=1)) - adjacency
    tutte = np.linalg.solve(laplacian[size:, size:], -laplacian[size:, :size])
    corner = size * (layers - 1) + divisions * np.arange(4)
    even = np.linspace(0, 1, divisions + 1)
    straight = np.zeros((8, 2, size))
    matrix = positions(
        np.eye(size),
        tutte[corner],
        straight,
        corners=(0, divisions, divisions),
        radial=np.linspace(0, 1, layers + 1),
        fractions=(even,) * 4,
    )
    return matrix, blocks


def corner_pairs(boundary: int) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]]:
    """Return every distinct choice of corners `(i0, m)` of a boundary with that many nodes, `m <= n`."""
    half = boundary // 2
    pairs = [(i0, m) for m in range(1, half // 2 + 1) for i0 in range(m if 2 * m == half else half)]
    i0, m = np.array(pairs).T
    return i0, m


def rank_corners(
    nodes: Float[np.ndarray, "l 2"], i0: np.ndarray, m: np.ndarray, divisions: int, layers: int
) -> np.ndarray:
    """Return a surrogate of the shape energy for each choice of corners, (c,), lower is better.

    Coarse O-grids with straight edges and Tutte's singular points; each has the (fractional) number of layers that
    makes its outer cells square on average.
    """
    size = len(nodes)
    n = size // 2 - m
    t = np.arange(divisions) / divisions
    start = i0[:, None] + np.stack([0 * m, m, m + n, 2 * m + n], axis=1)
    index = (start[:, :, None] + np.stack([m, n, m, n], axis=1)[:, :, None] * t).reshape(len(m), -1)
    low = np.floor(index).astype(np.int64)
    part = (index - low)[..., None]
    rim = (1 - part) * nodes[low % size] + part * nodes[(low + 1) % size]
    matrix, blocks = reference(divisions, layers)
    points = matrix @ rim
    ring = points[:, layers * 4 * divisions : (layers + 1) * 4 * divisions]
    spoke = np.linalg.norm(ring - rim, axis=-1).mean(axis=1)
    girth = sum(np.linalg.norm(np.roll(r, -1, axis=1) - r, axis=-1).sum(axis=1) for r in (rim, ring)) / 2
    k = spoke * size / girth
    along, total, weight = np.stack([m, n, m, n], axis=1) / divisions, np.zeros(len(m)), np.zeros(len(m))
    area = (girth / size) ** 2
    steps = [(along[:, 0], along[:, 1]), *((along[:, s], k / layers) for s in range(4))]
    for g, (first, second) in zip(blocks, steps, strict=True):
        grid = points[:, g]
        u = np.diff(grid, axis=1) / first[:, None, None, None]
        v = np.diff(grid, axis=2) / second[:, None, None, None]
        uu, vv = (u**2).sum(axis=-1), (v**2).sum(axis=-1)
        cells = first * second
        for a in (np.s_[:, :, :-1], np.s_[:, :, 1:]):
            for b in (np.s_[:, :-1], np.s_[:, 1:]):
                det = u[a][..., 0] * v[b][..., 1] - u[a][..., 1] * v[b][..., 0]
                floor = 0.05 * area[:, None, None]
                energy = (uu[a] + vv[b]) / (det + np.sqrt(floor**2 + det**2))
                total = total + cells * energy.sum(axis=(1, 2))
                weight = weight + cells * energy[0].size
    return total / weight
