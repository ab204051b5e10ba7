"""Tubes that begin at a loop are cut off where they flare, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.decompose.cells import submesh
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.cutgraph import trace
from drl_meshgen.partition import CutSurface, PartitionOptions, RegionKind, partition
from drl_meshgen.partition.collars import with_collars
from tests.chains import grid, tube

OPTIONS = PartitionOptions()


def trumpet(length: float, rim: float = 8.0) -> TriMesh:
    """Tube of radius 1 and this length, on a disk of radius `rim` with a hole."""
    up = np.arange(0, length + 0.2, 0.4)
    out = np.arange(1.4, rim, 0.4)
    radius = np.r_[np.ones(len(up)), out]
    height = np.r_[up, np.full(len(out), up[-1])]
    return tube(16, len(radius) - 1, radius, height)


def collars(surface: TriMesh, options: PartitionOptions = OPTIONS) -> tuple[CutSurface, np.ndarray]:
    whole = CutSurface.whole(surface, np.zeros(len(surface.vertices)))
    return with_collars(whole, surface.topology.loops, 0, options)


def lengths(cut: CutSurface) -> list[float]:
    edges = cut.mesh.topology.edges
    on = (cut.contour[edges] >= 0).all(axis=1) & (cut.contour[edges[:, 0]] == cut.contour[edges[:, 1]])
    return [closed_length(cut.mesh.vertices[curve]) for curve in trace(edges[on])]


def test_a_tube_is_cut_off_at_its_foot_and_the_wide_end_is_not():
    surface = trumpet(8.0)
    cut, tubes = collars(surface)
    (length,) = lengths(cut)
    assert length == pytest.approx(2 * np.pi, rel=0.3)
    height = cut.mesh.vertices[:, 2]
    assert height[cut.contour == 0].min() > 5
    assert height[tubes == 0].min() == 0
    assert (tubes[height > 8.1] == -1).all()
    assert cut.mesh.areas.sum() == pytest.approx(surface.areas.sum(), rel=1e-9)


@pytest.mark.parametrize("surface", [trumpet(1.2), grid(24, 12, holes=3)], ids=["short tube", "plate with holes"])
def test_holes_without_a_tube_get_no_collar(surface):
    cut, tubes = collars(surface)
    assert not lengths(cut)
    assert (tubes == -1).all()


def test_nothing_is_cut_where_nobody_wants_collars():
    assert not lengths(collars(trumpet(8.0), replace(OPTIONS, collar=0))[0])


def test_collars_do_not_depend_on_the_unit_of_length():
    surface = trumpet(8.0)
    one, two = (collars(s)[0] for s in (surface, TriMesh(1e3 * surface.vertices, surface.triangles)))
    # which of the levels is the last before the flare may differ by rounding: they are a few per cent apart
    assert lengths(two) == pytest.approx([1e3 * x for x in lengths(one)], rel=0.03)


def test_a_surface_that_is_a_tube_stays_one():
    surface = trumpet(8.0)
    assert [region.kind for region in partition(surface, np.zeros(len(surface.vertices))).regions] == [RegionKind.TUBE]


def test_a_tube_behind_one_of_three_loops_becomes_a_region_though_the_depth_is_flat():
    whole = trumpet(8.0)
    away = np.linalg.norm(whole.vertices - [5, 0, whole.vertices[:, 2].max()], axis=1)
    holed = submesh(whole, np.nonzero((away[whole.triangles] > 1).all(axis=1))[0])[0]
    kinds = sorted(region.kind.value for region in partition(holed, np.zeros(len(holed.vertices))).regions)
    assert kinds == ["junction", "tube"]
