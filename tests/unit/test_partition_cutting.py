"""Cutting along isocontours, their lengths, and midpoint refinement, on depths with known contours."""

import numpy as np
import pytest

from drl_meshgen.mesh.splitting import CLEARANCE
from drl_meshgen.partition.cutting import CutSurface, cut, midpoint_refined
from drl_meshgen.partition.levels import arc_lengths
from tests.chains import grid, surface_of, tube
from tests.strategies import flat_disk


def crossing(mesh, depth, level):
    return cut(CutSurface.whole(mesh, depth), depth > level, level, 0)


def test_the_contour_of_a_linear_depth_lies_on_the_level_where_it_is_not_kept_clear_of_a_vertex():
    disk = flat_disk(500)
    slope = np.array([0.8, 0.6, 0.0])
    level = 0.1234
    after = crossing(disk, disk.vertices @ slope, level)
    made = after.contour == 0
    off = np.abs(after.mesh.vertices[made] @ slope - level)
    assert (off < 1e-12).sum() > 0.5 * made.sum()
    assert off.max() <= CLEARANCE * disk.edge_lengths.max()


def test_new_points_keep_clear_of_the_ends_of_their_edges():
    disk = flat_disk(500)
    after = crossing(disk, disk.vertices[:, 0], 1e-9)
    new = np.nonzero(after.contour == 0)[0]
    edges = after.mesh.topology.edges
    along = (edges[:, 1, None] == new).any(axis=1) & (edges[:, 0] < len(disk.vertices))
    assert after.mesh.edge_lengths[along].min() >= CLEARANCE * disk.edge_lengths.min() * (1 - 1e-9)


@pytest.mark.parametrize("level", [-0.4, 0.0, 0.31])
def test_every_mixed_triangle_becomes_three_and_area_stays(level):
    disk = flat_disk(500)
    depth = disk.vertices[:, 1]
    mixed = np.isin((depth > level)[disk.triangles].sum(axis=1), (1, 2)).sum()
    after = crossing(disk, depth, level)
    assert len(after.mesh.triangles) == len(disk.triangles) + 2 * mixed
    assert after.mesh.area == pytest.approx(disk.area, rel=1e-12)
    assert (after.mesh.normals[:, 2] > 0.999).all()
    assert after.mesh.areas.min() > 0


def test_equal_depths_on_both_sides_are_cut_in_the_middle():
    sheet = grid(4, 4)
    flat = np.ones(len(sheet.vertices))
    inside = sheet.vertices[:, 0] > 1.5
    after = cut(CutSurface.whole(sheet, flat), inside, 1.0, 7)
    assert set(after.mesh.vertices[after.contour == 7][:, 0]) == {1.5}


def test_nothing_to_cut_changes_nothing():
    disk = flat_disk(300)
    after = crossing(disk, disk.vertices[:, 2], 1.0)
    np.testing.assert_array_equal(after.mesh.triangles, disk.triangles)
    np.testing.assert_array_equal(after.mesh.vertices, disk.vertices)


def test_length_of_a_contour_of_a_linear_depth_is_that_of_the_chord():
    sheet = grid(7, 5)
    faces = np.ones(len(sheet.triangles), bool)
    values = np.array([0.3, 2.5, 6.999])
    np.testing.assert_allclose(arc_lengths(sheet, sheet.vertices[:, 0], faces, values), 5.0, rtol=1e-12)


def test_length_of_contours_around_a_cylinder_is_its_girth():
    n = 60
    cylinder = tube(n, 20, np.ones(21), np.linspace(0, 3, 21))
    girth = arc_lengths(cylinder, cylinder.vertices[:, 2], np.ones(len(cylinder.triangles), bool), np.array([0.4, 1.7]))
    np.testing.assert_allclose(girth, 2 * np.pi, rtol=2 / n)


def test_midpoint_refinement_keeps_shape_and_old_vertices():
    coarse = surface_of("bumps")
    fine = midpoint_refined(coarse)
    np.testing.assert_array_equal(fine.vertices[: len(coarse.vertices)], coarse.vertices)
    assert len(fine.triangles) == 4 * len(coarse.triangles)
    assert fine.area == pytest.approx(coarse.area, rel=1e-12)
    assert fine.topology.euler == coarse.topology.euler
    assert not len(fine.topology.misoriented_edges)
    np.testing.assert_allclose(fine.normals, np.repeat(coarse.normals, 4, axis=0), atol=1e-9)
