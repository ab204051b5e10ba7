"""Choice of the four corners of an O-type mesh by scoring every choice on a coarse mesh at once."""

from functools import cache

import numpy as np
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import grids
from drl_meshgen.templates.options import PlacementOptions, Size


@cache
def reference(divisions: int, layers: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the matrix from 4 x divisions boundary points to all points of a coarse O-grid, and its grids.

    Every node lies at the mean of its neighbours: Tutte's embedding, linear in the boundary.
    """
    size = 4 * divisions
    blocks = grids(0, divisions, divisions, layers)
    quads = grid_quads(blocks)
    total = size * layers + (divisions + 1) ** 2
    pairs = np.unique(np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1), axis=0)
    adjacency = np.zeros((total, total))
    adjacency[pairs[:, 0], pairs[:, 1]] = adjacency[pairs[:, 1], pairs[:, 0]] = 1.0
    laplacian = np.diag(adjacency.sum(axis=1)) - adjacency
    with threadpool_limits(1):  # kept for the process, so whoever comes first must not decide its last digits
        inner = np.linalg.solve(laplacian[size:, size:], -laplacian[size:, :size])
    return np.concatenate([np.eye(size), inner]), blocks


def corner_pairs(boundary: int, counts: int) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]]:
    """Return the distinct choices of corners `(i0, m)`, `m <= n`, of a boundary with that many nodes.

    All positions for at most `counts` evenly spaced values of m, the largest of them (the squarest core) included.
    """
    half = boundary // 2
    values = half // 2 - np.unique(np.linspace(0, half // 2 - 1, min(counts, half // 2)).round().astype(np.int64))
    pairs = [(i0, m) for m in sorted(values.tolist()) for i0 in range(m if 2 * m == half else half)]
    i0, m = np.array(pairs).T
    return i0, m


def best_per_count(m: Int[np.ndarray, " c"], score: Float[np.ndarray, " c"], keep: int) -> Int[np.ndarray, " k"]:
    """Return the `keep` choices of lowest score for each `m`, by increasing `m` and score."""
    order = np.lexsort((score, m))
    place = np.arange(len(m)) - np.searchsorted(m[order], m[order])
    return order[place < keep]


def rank_corners(
    nodes: Float[np.ndarray, "l 2"],
    choices: tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]],
    resolution: tuple[int, int],
    size: Size | Float[np.ndarray, " l"],
    options: PlacementOptions,
) -> Float[np.ndarray, " c"]:
    """Return the energy of a coarse O-grid for each choice of corners `(i0, m)`, lower is better.

    Points by Tutte's embedding, `resolution` = (cells per side, layers); each has the (fractional) number
    of layers that makes its outer cells square on average. `size` is the wanted edge length as a function, or at the
    boundary nodes, from where its logarithm is interpolated like the points (cheaper).
    """
    (i0, m), (divisions, layers) = choices, resolution
    n = len(nodes) // 2 - m
    z = nodes[:, 0] + 1j * nodes[:, 1]  # plane points as complex numbers; choices are the last axis throughout
    side = np.stack([m, n, m, n])
    t = np.arange(divisions) / divisions
    index = ((i0 + np.cumsum(side, axis=0) - side)[:, None] + side[:, None] * t[:, None]).reshape(-1, len(m))
    low = np.floor(index).astype(np.int64)
    rim = z[low % len(z)] * (1 - index + low) + z[(low + 1) % len(z)] * (index - low)
    matrix, blocks = reference(divisions, layers)
    points = (matrix @ rim.view(np.float64)).view(np.complex128)
    ring = points[layers * len(rim) : (layers + 1) * len(rim)]
    spoke = np.abs(ring - rim).mean(axis=0)
    girth = (np.abs(np.roll(rim, -1, axis=0) - rim) + np.abs(np.roll(ring, -1, axis=0) - ring)).sum(axis=0) / 2
    k = spoke * len(z) / girth
    if callable(size):
        h = size(np.stack([points.real, points.imag], axis=-1).reshape(-1, 2)).reshape(points.shape)
    else:
        log = np.log(size)
        h = np.exp(matrix @ (log[low % len(z)] * (1 - index + low) + log[(low + 1) % len(z)] * (index - low)))
    total, weight = np.zeros(len(m)), np.zeros(len(m))
    steps = [(m, n), *((count, k * divisions / layers) for count in side)]
    for grid, (first, second) in zip(blocks, steps, strict=True):
        u = np.diff(points[grid], axis=0) * (divisions / first)
        v = np.diff(points[grid], axis=1) * (divisions / second)
        uu, vv = u.real**2 + u.imag**2, v.real**2 + v.imag**2
        cells, area = first * second, h[grid] ** 2
        for a in (np.s_[:-1], np.s_[1:]):
            for b in (np.s_[:-1], np.s_[1:]):
                wanted = area[a, b]
                det = (u[:, b].conj() * v[a]).imag / wanted
                spread = (uu[:, b] + vv[a]) / wanted + options.size_weight * (1 + det * det)
                energy = spread / (det + np.sqrt(options.epsilon**2 + det * det))
                total += cells * energy.sum(axis=(0, 1))
                weight += cells * energy[..., 0].size
    return total / weight
