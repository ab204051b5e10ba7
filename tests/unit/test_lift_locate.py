"""From charts back to the surface: round trips through triangles, period and border."""

import numpy as np
import pytest

from drl_meshgen.lift.harmonic import disk_chart
from drl_meshgen.lift.locate import barycentric, locate, locate_in_ring
from drl_meshgen.quality.closest import closest_on_segments, closest_on_triangles
from tests.chains import SURFACES, chain
from tests.strategies import bumpy_disk


def scattered(mesh, seed, n=500):
    rng = np.random.default_rng(seed)
    return rng.integers(0, len(mesh.triangles), n), rng.dirichlet(np.ones(3), n)


def test_points_of_a_disk_chart_come_back_to_where_they_were():
    disk = bumpy_disk(800, 3, 1.2, seed=2)
    loop = disk.topology.loops[0]
    plane = disk_chart(disk, loop, 2 * np.pi * np.arange(len(loop)) / len(loop))[disk.triangles]
    triangle, weights = scattered(disk, 0)
    found, bary = locate(plane, np.einsum("qk,qkd->qd", weights, plane[triangle]))
    before = np.einsum("qk,qkd->qd", weights, disk.corners[triangle])
    np.testing.assert_allclose(np.einsum("qk,qkd->qd", bary, disk.corners[found]), before, atol=1e-7)


@pytest.mark.parametrize("turns", [0, 1, -3])
def test_points_of_ring_charts_come_back_whatever_turn_they_are_on(turns):
    for k, ring in enumerate(chain("two limbs")["decompose"].pieces.rings):
        triangle, weights = scattered(ring.mesh, k)
        h_corner = ring.chart.h[ring.mesh.triangles]
        corners = np.stack([ring.chart.theta_corner, h_corner], axis=-1)
        wanted = np.einsum("qk,qkd->qd", weights, corners[triangle]) + np.array([turns, 0])
        found, bary = locate_in_ring(ring.chart.theta_corner, h_corner, wanted)
        before = np.einsum("qk,qkd->qd", weights, ring.mesh.corners[triangle])
        after = np.einsum("qk,qkd->qd", bary, ring.mesh.corners[found])
        np.testing.assert_allclose(after, before, atol=1e-5 * ring.mesh.diagonal)


def test_barycentric_coordinates_reproduce_points_inside_and_stay_inside_for_points_outside():
    corner = np.array([[[0, 0], [2, 0], [0, 1]]], float).repeat(3, axis=0)
    points = np.array([[0.5, 0.25], [2.0, 0.0], [-1.0, -1.0]])
    bary = barycentric(corner, points)
    np.testing.assert_allclose(bary.sum(axis=1), 1)
    assert bary.min() >= 0
    np.testing.assert_allclose(np.einsum("qk,qkd->qd", bary, corner)[:2], points[:2])


def test_barycentric_coordinates_of_a_triangle_without_area_are_its_centre():
    flat = np.zeros((1, 3, 2))
    np.testing.assert_allclose(barycentric(flat, np.zeros((1, 2))), 1 / 3)


@pytest.mark.parametrize("name", SURFACES)
def test_lifted_nodes_lie_on_the_surface_in_the_triangle_they_carry(name):
    run = chain(name)
    surface, lifted = run["cleanup"].surface, run["lift"]
    points = lifted.mesh.points
    own = closest_on_triangles(points, surface.corners[lifted.triangle])
    assert np.linalg.norm(own - points, axis=1).max() < 1e-9 * surface.diagonal


@pytest.mark.parametrize("name", SURFACES)
def test_boundary_nodes_are_lifted_to_the_boundary(name):
    run = chain(name)
    surface, mesh = run["cleanup"].surface, run["lift"].mesh.mesh
    a, b = surface.vertices[surface.topology.boundary_edges.T]
    points = mesh.points[mesh.topology.on_boundary][:, None]
    gap = np.linalg.norm(closest_on_segments(points, a, b) - points, axis=-1).min(axis=1)
    assert gap.max() < 1e-6 * surface.diagonal
