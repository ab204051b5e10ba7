"""Tubes that begin at a curve, whatever the depth says: a flat tube has no isocontours around it.

For each curve, `h` is harmonic, 1 there and 0 on all other curves. Along a tube of girth L the
part (1 - h) / E of its conformal modulus lies behind a level, E being the flux of `h` through the loop; so lengths of
levels over that modulus tell where the tube flares.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.lift.harmonic import corner_weights, dirichlet, stiffness
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.splitting import crossing
from drl_meshgen.partition.cutting import CutSurface, between, cut, superlevel
from drl_meshgen.partition.levels import PartitionOptions, arc_lengths

SAMPLES = 49
"""Levels at which the girth is looked at, as many again for equal areas between them."""
WINDOW = 0.1
"""Length to either side over which the flare is measured (girths)."""


def with_collars(
    surface: CutSurface, curves: Sequence[Int[np.ndarray, " n"]], contours: int, options: PartitionOptions
) -> tuple[CutSurface, Int[np.ndarray, " v"]]:
    """Cut off tubes that begin at one of `curves` and are at least `options.collar` girths long.

    `curves` are loops of regions of `surface`, which has `contours` contours so far. Returns the surface and, for each
    vertex, the contour that cuts its tube off, -1 elsewhere.
    """
    tube = np.full(len(surface.mesh.vertices), -1)
    if not curves or not options.collar:
        return surface, tube
    functions, flux = _functions(surface, curves)
    for k, curve in enumerate(curves):
        level = _end(surface.mesh, functions[:, k], curve, float(flux[k]), options)
        if level is None:
            continue
        inside = superlevel(surface.mesh, functions[:, k] > level, int(curve[0]))
        others = surface.mesh.topology.on_boundary | (surface.contour >= 0)
        others[curve] = False
        if inside[others].any():
            continue
        edges = surface.mesh.topology.edges
        a, b = edges[inside[edges[:, 0]] != inside[edges[:, 1]]].T
        share = crossing(functions[a, k], functions[b, k], level)
        surface = cut(surface, inside, level, contours, functions[:, k])
        functions = np.vstack([functions, between(functions, a, b, share)])
        tube = np.r_[np.where(inside, contours, tube), np.full(len(share), contours)]
        contours += 1
    return surface, tube


def _functions(
    surface: CutSurface, curves: Sequence[Int[np.ndarray, " n"]]
) -> tuple[Float[np.ndarray, "v k"], Float[np.ndarray, " k"]]:
    """Harmonic function of each curve, 0 on all others, and its flux."""
    mesh = surface.mesh
    known = np.nonzero(mesh.topology.on_boundary | (surface.contour >= 0))[0]
    values = np.zeros((len(mesh.vertices), len(curves)))
    for k, curve in enumerate(curves):
        values[curve, k] = 1.0
    matrix = stiffness(mesh, corner_weights(mesh))
    functions = dirichlet(matrix, known, values[known])
    return functions, np.einsum("vk,vk->k", functions, matrix @ functions)


def _end(
    mesh: TriMesh, h: Float[np.ndarray, " v"], curve: Int[np.ndarray, " n"], flux: float, options: PartitionOptions
) -> float | None:
    """Level at which the tube behind `curve` begins to flare; None where it is too short."""
    even = np.linspace(1, 0, SAMPLES + 2)[1:-1]
    order = np.argsort(h, kind="stable")
    area = np.cumsum(mesh.vertex_areas[order])
    by_area = h[order[np.searchsorted(area, even * area[-1])]]
    values = np.unique(np.r_[even, by_area])[::-1]
    values = values[(values > even[-1] / 2) & (values < 1 - even[-1] / 2)]
    lengths = arc_lengths(mesh, h, np.asarray((h[mesh.triangles] > 0).any(axis=1)), values)
    girth = np.r_[closed_length(mesh.vertices[curve]), np.maximum(lengths, np.finfo(float).tiny)]
    modulus = (1 - np.r_[1.0, values]) / flux
    ahead = np.minimum(np.searchsorted(modulus, modulus + WINDOW), len(modulus) - 1)
    behind = np.maximum(np.searchsorted(modulus, modulus - WINDOW, side="right") - 1, 0)
    flare = np.log(girth[ahead] / girth[behind]) / (modulus[ahead] - modulus[behind])
    wide = (flare > options.flare) | (girth > options.widening * np.minimum.accumulate(girth))
    last = int(np.argmax(wide)) - 1 if wide.any() else len(girth) - 1
    return float(values[last - 1]) if last > 0 and modulus[last] >= options.collar else None
