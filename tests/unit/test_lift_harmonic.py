"""Charts of rings and disks: exact cases, the maximum principle, orientation and period."""

import numpy as np
import pytest

from drl_meshgen.lift.harmonic import WEIGHT_RANGE, corner_weights, dirichlet, disk_chart, ring_chart, stiffness
from drl_meshgen.mesh import TriMesh
from tests.chains import chain, tube
from tests.strategies import bumpy_disk, flat_disk, rigidly_moved


def cylinder(around=24, rows=10, height=3.0):
    return tube(around, rows, np.ones(rows + 1), np.linspace(0, height, rows + 1))


def ring_loops(around, rows):
    """First and last row of `tube`, both anti-clockwise about z."""
    return np.arange(around), rows * around + np.arange(around)


def wavy(around=40, rows=14):
    z = np.linspace(0, 2, rows + 1)
    ring = tube(around, rows, 1 + 0.4 * np.sin(2 * z), z)
    x, y, z = ring.vertices.T
    return TriMesh(np.c_[x, y * (1 + 0.3 * z), z + 0.3 * x * y], ring.triangles), *ring_loops(around, rows)


def signed_areas(corner, h):
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    p, q = h[:, 1] - h[:, 0], h[:, 2] - h[:, 0]
    return a * q - b * p


def test_chart_of_a_cylinder_is_exact():
    around, rows, height = 24, 10, 3.0
    mesh = cylinder(around, rows, height)
    chart = ring_chart(mesh, *ring_loops(around, rows))
    np.testing.assert_allclose(chart.h, mesh.vertices[:, 2] / height, atol=1e-12)
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0]) / (2 * np.pi)
    turn = chart.theta - angle - (chart.theta - angle)[0]
    np.testing.assert_allclose(turn, np.round(turn), atol=1e-12)
    p = mesh.corners[0]
    slant = np.linalg.norm((p[0] + p[1]) / 2 - p[2])  # height of a triangle of the polyhedral cylinder
    girth = around * 2 * np.sin(np.pi / around)
    assert chart.modulus == pytest.approx(rows * slant / girth, rel=1e-12)


def test_turning_a_ring_upside_down_turns_its_chart():
    mesh, first, second = wavy()
    one, two = ring_chart(mesh, first, second), ring_chart(mesh, second, first)
    np.testing.assert_allclose(two.h, 1 - one.h, atol=1e-12)
    assert two.modulus == pytest.approx(one.modulus, rel=1e-12)
    total = one.theta + two.theta - (one.theta + two.theta)[0]
    np.testing.assert_allclose(total, np.round(total), atol=1e-9)


def test_theta_and_h_are_right_handed_in_every_triangle():
    mesh, first, second = wavy()
    for loops in ((first, second), (second, first)):
        chart = ring_chart(mesh, *loops)
        assert signed_areas(chart.theta_corner, chart.h[mesh.triangles]).min() > 0


def test_a_ring_chart_covers_the_unit_cylinder_once():
    mesh, first, second = wavy()
    chart = ring_chart(mesh, first, second)
    assert signed_areas(chart.theta_corner, chart.h[mesh.triangles]).sum() / 2 == pytest.approx(1, rel=1e-9)
    turns = chart.theta_corner - chart.theta[mesh.triangles]
    np.testing.assert_allclose(turns, turns > 0.5, atol=1e-12)


def test_theta_rises_by_one_period_around_every_loop():
    mesh, first, second = wavy()
    chart = ring_chart(mesh, first, second)
    for loop in (first, second):
        step = np.diff(chart.theta[np.r_[loop, loop[0]]])
        step -= np.round(step)
        assert step.sum() == pytest.approx(1, rel=1e-12)


def test_h_obeys_the_maximum_principle():
    mesh, first, second = wavy()
    h = ring_chart(mesh, first, second).h
    inner = ~mesh.topology.on_boundary
    assert (h[first] == 0).all()
    assert (h[second] == 1).all()
    assert h[inner].min() > 0
    assert h[inner].max() < 1
    edges = mesh.topology.edges
    highest = np.full(len(h), -1.0)
    np.maximum.at(highest, edges[:, 0], h[edges[:, 1]])
    np.maximum.at(highest, edges[:, 1], h[edges[:, 0]])
    assert (h[inner] < highest[inner]).all()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_ring_chart_does_not_depend_on_place_and_unit(scale):
    mesh, first, second = wavy()
    one = ring_chart(mesh, first, second)
    two = ring_chart(rigidly_moved(mesh, seed=2, scale=scale), first, second)
    np.testing.assert_allclose(two.h, one.h, atol=1e-9)
    np.testing.assert_allclose(two.theta_corner, one.theta_corner, atol=1e-9)
    assert two.modulus == pytest.approx(one.modulus, rel=1e-9)


def test_charts_of_all_rings_of_a_decomposition_are_right_handed():
    for ring in chain("four limbs")["decompose"].pieces.rings:
        areas = signed_areas(ring.chart.theta_corner, ring.chart.h[ring.mesh.triangles])
        on_outer = np.isin(ring.mesh.triangles, ring.outer).all(axis=1)  # no height: an ear of the spine's zigzag
        assert areas[~on_outer].min() > -1e-15
        assert (areas[~on_outer] > 0).mean() > 0.999
        for loop in (ring.inner, ring.outer):
            theta = ring.unwrapped(loop)
            assert (np.diff(np.r_[theta, theta[0] + 1]) > 0).all()


@pytest.mark.parametrize("name", ["disk", "bumps", "four limbs"])
def test_charts_of_all_caps_fill_the_unit_disk_without_folds(name):
    caps = chain(name)["decompose"].pieces.caps
    assert caps
    for cap in caps:
        p = cap.plane[cap.mesh.triangles]
        areas = signed_areas(p[..., 0], p[..., 1])
        n = len(cap.loop)
        assert areas.min() > 0
        assert np.linalg.norm(cap.plane, axis=1).max() <= 1 + 1e-12
        step = 2 * np.pi * np.diff(np.r_[cap.share, cap.share[0] + 1])
        assert len(step) == n
        assert areas.sum() == pytest.approx(np.sin(step).sum(), rel=1e-9)


def test_the_disk_chart_of_a_round_flat_disk_is_close_to_the_disk_itself():
    disk = flat_disk(400)
    loop = disk.topology.loops[0]
    angle = np.arctan2(disk.vertices[loop, 1], disk.vertices[loop, 0])
    np.testing.assert_allclose(disk_chart(disk, loop, angle), disk.vertices[:, :2], atol=0.01)


def test_disk_charts_stay_in_the_disk_and_do_not_fold():
    disk = bumpy_disk(1200, 4, 2.0, seed=9)
    loop = disk.topology.loops[0]
    angle = np.cumsum(np.random.default_rng(1).uniform(0.2, 1, len(loop)))
    plane = disk_chart(disk, loop, 2 * np.pi * angle / angle[-1])
    p = plane[disk.triangles]
    assert signed_areas(p[..., 0], p[..., 1]).min() > 0
    assert np.linalg.norm(plane, axis=1).max() <= 1 + 1e-12


def test_linear_functions_on_a_plane_are_harmonic_also_where_triangles_are_obtuse():
    ring = tube(30, 8, 1.2 ** np.arange(8, -1, -1), np.zeros(9))
    inner = ~ring.topology.on_boundary
    shift = 0.3 * ring.edge_lengths.min() * np.random.default_rng(3).uniform(-1, 1, (inner.sum(), 2))
    points = ring.vertices.copy()
    points[inner, :2] += shift
    ring = TriMesh(points, ring.triangles)
    p = ring.corners
    sides = np.stack([((p[:, (k + 1) % 3] - p[:, k]) * (p[:, (k + 2) % 3] - p[:, k])).sum(1) for k in range(3)])
    assert (sides < 0).any()
    weights = corner_weights(ring)
    assert WEIGHT_RANGE[0] < weights.min()  # every edge is Delaunay, nothing is clipped
    known = np.nonzero(~inner)[0]
    values = ring.vertices[:, :2] @ np.array([[2.0, 0.3], [-1.0, 0.7]]) + 5
    np.testing.assert_allclose(dirichlet(stiffness(ring, weights), known, values[known]), values, atol=1e-11)


def test_stiffness_is_symmetric_has_constants_in_its_kernel_and_is_semidefinite():
    disk = bumpy_disk(300, 3, 2.0, seed=4)
    matrix = stiffness(disk, corner_weights(disk)).toarray()
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-13)
    np.testing.assert_allclose(matrix.sum(axis=1), 0, atol=1e-11)
    assert np.linalg.eigvalsh(matrix)[0] > -1e-10
    assert (matrix - np.diag(np.diag(matrix))).max() <= 0


def test_harmonic_extension_of_values_known_everywhere_is_themselves():
    disk = flat_disk(200)
    values = np.random.default_rng(0).normal(size=(len(disk.vertices), 1))
    matrix = stiffness(disk, corner_weights(disk))
    np.testing.assert_array_equal(dirichlet(matrix, np.arange(len(values)), values), values)
