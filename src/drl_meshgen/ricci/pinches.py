"""Necks of three edges: the limbs that isotropic remeshing has pinched."""

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import TriMesh


def separating_triangles(surface: TriMesh) -> Int[np.ndarray, "n 3"]:
    """Return the cycles of three edges that bound no face, as increasing vertex triples in lexicographic order.

    On a surface of genus 0 each of them separates: a limb pinched to a ring of three edges. Boundary loops of three
    edges are left out.
    """
    topology, n = surface.topology, np.int64(len(surface.vertices))
    vertex = np.lexsort((np.arange(n), topology.valence))
    rank = np.argsort(vertex)
    code = np.sort(rank[topology.edges], axis=1) @ np.array(
        [n, 1]
    )  # from low to high rank: few edges leave each vertex
    code.sort()
    tail, head = code // n, code % n
    start = np.searchsorted(tail, np.arange(n + 1))
    leaving = np.diff(start)[head]
    first = np.repeat(np.arange(len(code)), leaving)
    second = np.arange(len(first)) + np.repeat(start[head] - np.cumsum(leaving) + leaving, leaving)
    low, middle, high = tail[first], head[first], head[second]
    closed = code[np.minimum(np.searchsorted(code, low * n + high), len(code) - 1)] == low * n + high
    loops = [loop for loop in topology.loops if len(loop) == 3]
    filled = np.sort(rank[np.concatenate([surface.triangles, np.array(loops, np.int64).reshape(-1, 3)])], axis=1)
    bounded = np.searchsorted(code, filled[:, 0] * n + filled[:, 1]) * n + filled[:, 2]
    empty = closed & ~np.isin(first * n + high, bounded)
    cycles = np.sort(vertex[np.c_[low, middle, high][empty]], axis=1)
    return cycles[np.lexsort(cycles.T[::-1])]
