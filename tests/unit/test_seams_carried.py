"""Surfaces cut open along seams come out whole: both sides of a seam have the same nodes, and no trace is left."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from drl_meshgen.cleanup import CleanupResult
from drl_meshgen.mesh import TriMesh
from drl_meshgen.partition import RegionKind
from drl_meshgen.pipeline import STAGES, MeshOptions
from drl_meshgen.seams import OpenedSurface, Seam, SeamKind
from drl_meshgen.store import Execution, execute
from tests.chains import grid
from tests.strategies import flat_disk, limbed_disk


def whole(mesh, seams=()):
    return OpenedSurface(mesh, np.arange(len(mesh.triangles)), seams, pd.DataFrame({"seam": range(len(seams))}))


def torus() -> tuple[TriMesh, OpenedSurface]:
    """Torus, cut open along one of its meridians."""
    n, m = 60, 30
    closed = grid(n, m, torus=True)
    column = closed.triangles // m
    last = (column == n - 1).any(axis=1)[:, None] & (column == 0)
    opened = np.where(last, closed.triangles + n * m, closed.triangles)
    left = np.roll(np.arange(m), 7)
    seam = Seam(left, left + n * m, SeamKind.HANDLE)
    return closed, whole(TriMesh(np.vstack([closed.vertices, closed.vertices[:m]]), opened), (seam,))


def ball() -> tuple[TriMesh, OpenedSurface]:
    """Sphere, cut open along its equator."""
    disk = flat_disk(2000)
    r = np.linalg.norm(disk.vertices, axis=1).clip(1e-12)
    flat = disk.vertices * (np.sin(r * np.pi / 2) / r)[:, None]
    up = np.cos(np.minimum(r, 1) * np.pi / 2)
    upper, lower = flat + [[0, 0, 1]] * up[:, None], flat - [[0, 0, 1]] * up[:, None]
    n, rim = len(r), disk.topology.loops[0]
    points = np.vstack([upper, lower])
    points[n + rim] = points[rim]
    below = disk.triangles[:, ::-1] + n
    weld = np.arange(2 * n)
    weld[n + rim] = rim
    triangles = np.vstack([disk.triangles, below])
    opened = whole(TriMesh(points, triangles), (Seam(rim, n + rim, SeamKind.WAIST),))
    return TriMesh(points, weld[triangles]), opened


def two() -> tuple[TriMesh, OpenedSurface]:
    """A limbed disk beside a flat one."""
    one, other = limbed_disk(3000, 2, 2.5, seed=1), flat_disk(600)
    shift = [10.0, 0, 0]
    n = len(one.vertices)
    both = TriMesh(np.vstack([one.vertices, other.vertices + shift]), np.vstack([one.triangles, other.triangles + n]))
    return both, whole(both)


CASES = {"torus": torus, "ball": ball, "two": two}


@pytest.fixture(scope="module", params=CASES)
def case(request) -> tuple[str, TriMesh, OpenedSurface, Execution]:
    surface, opened = CASES[request.param]()
    given = {
        "model": lambda _inputs, _options: None,
        "cleanup": lambda _inputs, _options: CleanupResult(surface, pd.DataFrame()),
        "seams": lambda _inputs, _options: opened,
    }
    stages = [replace(stage, run=given.get(stage.name, stage.run)) for stage in STAGES]
    return request.param, surface, opened, execute(stages, MeshOptions().sized(800).by_stage("surface"))


def test_the_mesh_has_the_topology_of_the_surface(case):
    _, surface, _, done = case
    mine, theirs = done["smoothing"].mesh.mesh.topology, surface.topology
    assert mine.euler == theirs.euler
    assert len(mine.loops) == len(theirs.loops)
    assert mine.components[0] == theirs.components[0]
    assert done["quality"].defects == ()


def test_all_quads_are_well_shaped(case):
    _, _, _, done = case
    assert done["quality"].metrics["min_angle"] > 40
    assert done["quality"].metrics["surface_deviation"] < 0.02


def test_both_sides_of_a_seam_are_curves_over_the_same_points(case):
    _, _, opened, done = case
    parts = done["partition"]
    points = parts.surface.mesh.vertices
    assert len(parts.seams) == len(opened.seams)
    for one, other in parts.seams:
        first, second = parts.curves[one], parts.curves[other]
        np.testing.assert_array_equal(points[first.vertices], points[second.vertices])
        assert not first.is_boundary
        assert not second.is_boundary
        assert done["decompose"].curve_counts[one] == done["decompose"].curve_counts[other]


def test_regions_and_blocks_are_those_the_shape_asks_for(case):
    name, _, _, done = case
    kinds = sorted(region.kind.value for region in done["partition"].regions)
    irregular = int(done["smoothing"].mesh.mesh.irregular.sum())
    if name == "torus":
        assert (kinds, irregular) == (["tube"], 0)
    elif name == "ball":
        assert (kinds, irregular) == (["cap", "cap"], 8)
    else:
        assert kinds.count(RegionKind.CAP.value) == 3


def test_what_is_written_is_what_is_read(case, tmp_path):
    _, _, _, done = case
    for name in ("seams", "partition", "decompose"):
        stage = next(stage for stage in STAGES if stage.name == name)
        (tmp_path / name).mkdir()
        stage.write(done[name], tmp_path / name)
        back = stage.read(tmp_path / name)
        if name == "seams":
            for mine, theirs in zip(back.seams, done[name].seams, strict=True):
                np.testing.assert_array_equal(mine.left, theirs.left)
                np.testing.assert_array_equal(mine.right, theirs.right)
                assert mine.kind is theirs.kind
        else:
            assert (back.seams if name == "partition" else back.pieces.seams) == done["partition"].seams
