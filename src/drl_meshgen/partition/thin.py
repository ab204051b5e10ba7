"""Limbs too thin for the wanted quads: they stay with what they grow from, as they would get slivers for rings."""

import numpy as np
from jaxtyping import Bool, Float

from drl_meshgen.mesh import TriMesh
from drl_meshgen.partition.join_tree import Arc, JoinTree
from drl_meshgen.partition.levels import PartitionOptions, arc_lengths

SAMPLES = 9
"""Contours by which the girth of a limb is judged."""


def levelled(
    surface: TriMesh,
    depth: Float[np.ndarray, " v"],
    tree: JoinTree,
    options: PartitionOptions,
    size: Float[np.ndarray, " v"],
) -> Float[np.ndarray, " v"]:
    """Return `depth` with limbs that are too thin levelled at their saddle; `depth` itself where there are none.

    A limb runs from a saddle to one tip. It is too thin if the median length of its contours is less than
    `options.least_girth` wanted edges and its area less than `options.small_limb` wanted quads: a long thin limb
    stays, since without it the mesh would miss too much. `size (v,)` is the length of wanted edges (model units).
    """
    flat = depth
    for arc in tree.arcs:
        if arc.upper < 0 <= arc.lower:
            limb = np.isin(tree.basin, arc.tips) & (depth > arc.low)
            small = (surface.vertex_areas[limb] / size[limb] ** 2).sum() < options.small_limb
            if small and _girth(surface, depth, arc, limb, size) < options.least_girth:
                flat = np.where(limb, arc.low, flat)
    return flat


def _girth(
    surface: TriMesh, depth: Float[np.ndarray, " v"], arc: Arc, limb: Bool[np.ndarray, " v"], size: np.ndarray
) -> float:
    """Median length of contours of a limb (wanted edges)."""
    faces = np.asarray(limb[surface.triangles].any(axis=1))
    values = arc.low + (arc.high - arc.low) * (np.arange(SAMPLES) + 0.5) / SAMPLES
    return float(np.median(arc_lengths(surface, depth, faces, values)) / size[limb].mean())
