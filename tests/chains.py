"""Small surfaces, their runs through the pipeline (once per session), and surfaces with many loops."""

from dataclasses import replace
from functools import cache

import numpy as np

from drl_meshgen.cleanup import CleanupOptions
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.surface import RawSurface
from drl_meshgen.pipeline import STAGES, MeshOptions
from drl_meshgen.sizing import SizeOptions
from drl_meshgen.store import Execution, execute
from tests.strategies import bumpy_disk, flat_disk, limbed_disk


def grid(n: int, m: int, holes: int = 0, *, torus: bool = False) -> TriMesh:
    """Sheet of `n x m` squares, two triangles each, or a torus, with square holes of one cell along its middle row.

    The sheet has `holes + 1` loops, the torus `holes` loops and genus 1.
    """
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    wrap = (n, m) if torus else (n + 1, m + 1)
    node = lambda a, b: (a % wrap[0]) * wrap[1] + b % wrap[1]  # noqa: E731
    a, b, c, d = node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)
    turned = (i + j) % 2 == 0
    one = np.where(turned[..., None], np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    two = np.where(turned[..., None], np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    full = np.ones((n, m), bool)
    full[((2 * np.arange(holes) + 1) * n) // (2 * holes or 1), m // 2] = False
    triangles = np.concatenate([one[full], two[full]])
    s, t = (x.ravel() for x in np.meshgrid(np.arange(wrap[0]), np.arange(wrap[1]), indexing="ij"))
    if torus:
        s, t = 2 * np.pi * s / n, 2 * np.pi * t / m
        points = np.c_[(2 + np.cos(t)) * np.cos(s), (2 + np.cos(t)) * np.sin(s), np.sin(t)]
    else:
        points = np.c_[s, t, 0 * s].astype(float)
    return TriMesh(points, triangles)


def tube(around: int, rows: int, radius: np.ndarray, height: np.ndarray) -> TriMesh:
    """Surface of revolution about z with normals outwards: row `r` of `rows + 1` has its radius and height.

    Rows are shifted by half a spacing against each other. Vertices row after row.
    """
    turn = 2 * np.pi * (np.arange(around) + 0.5 * (np.arange(rows + 1)[:, None] % 2)) / around
    points = np.stack([radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn), height[:, None] + 0 * turn], -1)
    ids = np.arange((rows + 1) * around).reshape(rows + 1, around)
    ahead = np.roll(ids, -1, axis=1)
    even = (np.arange(rows) % 2 == 0)[:, None, None]
    a, b, c, d = ids[:-1], ahead[:-1], ids[1:], ahead[1:]
    one = np.where(even, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    two = np.where(even, np.stack([b, d, c], -1), np.stack([a, d, c], -1))
    return TriMesh(points.reshape(-1, 3), np.concatenate([one, two]).reshape(-1, 3))


#: Surfaces of the tests of the core, and the number of quads wanted on them.
SURFACES = {
    "disk": (lambda: flat_disk(600), 200),
    "bumps": (lambda: bumpy_disk(1500, 3, 1.5, seed=1), 400),
    "two limbs": (lambda: limbed_disk(3000, 2, 2.5, seed=1), 500),
    "four limbs": (lambda: limbed_disk(4000, 4, 2.0, seed=3), 700),
    "plate with holes": (lambda: grid(24, 12, holes=3), 400),
}


@cache
def surface_of(name: str) -> TriMesh:
    """One of `SURFACES`."""
    return SURFACES[name][0]()


def run_on(surface: TriMesh, quads: int, targets: list[str] | None = None, **layout: object) -> Execution:
    """Run all stages (or up to `targets`) on a surface, unrefined, in memory; holes ask for no smaller quads."""
    raw = RawSurface("surface", surface.vertices, surface.triangles)
    given = replace(STAGES[0], run=lambda _inputs, _options: raw)
    options = replace(MeshOptions().sized(quads), cleanup=CleanupOptions(min_triangles=0))
    options = replace(options, sizing=SizeOptions(around=0), decompose=replace(options.decompose, **layout))
    return execute((given, *STAGES[1:]), options.by_stage("surface"), targets=targets)


@cache
def chain(name: str) -> Execution:
    """All stages on one of `SURFACES`."""
    return run_on(surface_of(name), SURFACES[name][1])
