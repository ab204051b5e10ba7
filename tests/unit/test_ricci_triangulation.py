import numpy as np
import pytest

from drl_meshgen.ricci.flow import vertex_curvature
from drl_meshgen.ricci.triangulation import (
    Triangulation,
    corners,
    cosines,
    flip,
    intrinsic_delaunay,
    ptolemy_delaunay,
)
from tests.ricci_shapes import annulus, bumpy_disk


@pytest.fixture(scope="module")
def bumpy():
    return bumpy_disk(40, seed=3, height=1.0)


def area(triangulation):
    a, b, c = np.exp(triangulation.log_lengths.T)
    s = (a + b + c) / 2
    return np.sqrt(s * (s - a) * (s - b) * (s - c)).sum()


def worst_excess(log_lengths, glue):
    cosine = cosines(log_lengths).ravel()
    inner = glue >= 0
    return (cosine[inner] + cosine[glue[inner]]).min()


def is_consistent(t):
    inner = np.nonzero(t.glue >= 0)[0]
    lengths, tails, heads = t.log_lengths.ravel(), t.tails.ravel(), t.heads.ravel()
    return (
        np.array_equal(t.glue[t.glue[inner]], inner)
        and np.array_equal(lengths[inner], lengths[t.glue[inner]])
        and np.array_equal(tails[inner], heads[t.glue[inner]])
    )


@pytest.mark.parametrize("surface", [bumpy_disk(20, 0, 1.0), annulus(12)], ids=["disk", "annulus"])
def test_gluing_pairs_the_two_sides_of_every_inner_edge_in_opposite_directions(surface):
    t = Triangulation.of(surface)
    assert is_consistent(t)
    assert (t.glue < 0).sum() == len(surface.topology.boundary_edges)
    ends = np.c_[t.tails.ravel(), t.heads.ravel()]
    expected = np.linalg.norm(surface.vertices[ends[:, 1]] - surface.vertices[ends[:, 0]], axis=1)
    np.testing.assert_allclose(np.exp(t.log_lengths.ravel()), expected, rtol=1e-14)


def test_two_flips_of_one_edge_swap_its_faces_and_nothing_else(bumpy):
    t = Triangulation.of(bumpy)
    slot = np.nonzero(t.glue >= 0)[0][[0]]
    f, g = slot[0] // 3, t.glue[slot[0]] // 3
    once = flip(t, slot, np.array([0.5]))
    twice = flip(once, np.array([3 * f + 1]), t.log_lengths.ravel()[slot])
    assert is_consistent(once)
    assert is_consistent(twice)
    assert set(twice.faces[f]) == set(t.faces[g])
    assert set(twice.faces[g]) == set(t.faces[f])
    np.testing.assert_array_equal(np.sort(twice.log_lengths[f]), np.sort(t.log_lengths[g]))


def test_delaunay_flips_keep_area_and_curvature_of_the_flat_metric(bumpy):
    t = Triangulation.of(bumpy)
    delaunay, flips = intrinsic_delaunay(t)
    assert flips > 20
    assert is_consistent(delaunay)
    assert area(delaunay) == pytest.approx(area(t), rel=1e-12)
    before = vertex_curvature(bumpy, t.faces, corners(t.log_lengths).angles)
    after = vertex_curvature(bumpy, delaunay.faces, corners(delaunay.log_lengths).angles)
    np.testing.assert_allclose(after, before, atol=1e-11)


def test_no_inner_edge_is_left_with_opposite_angles_above_pi(bumpy):
    t = Triangulation.of(bumpy)
    u = np.random.default_rng(0).normal(0, 1, len(bumpy.vertices))
    assert worst_excess(t.log_lengths, t.glue) < -0.1
    delaunay, _ = intrinsic_delaunay(t)
    assert worst_excess(delaunay.log_lengths, delaunay.glue) >= -1e-11
    scaled, _ = ptolemy_delaunay(delaunay, u)
    assert worst_excess(scaled.scaled(u), scaled.glue) >= -1e-11


def test_ptolemy_flips_end_with_the_same_metric_whatever_scale_they_passed_through(bumpy):
    delaunay, _ = intrinsic_delaunay(Triangulation.of(bumpy))
    rng = np.random.default_rng(1)
    u, detour = rng.normal(0, 1, (2, len(bumpy.vertices)))
    straight, _ = ptolemy_delaunay(delaunay, u)
    around, _ = ptolemy_delaunay(ptolemy_delaunay(delaunay, detour)[0], u)
    expected = vertex_curvature(bumpy, straight.faces, corners(straight.scaled(u)).angles)
    found = vertex_curvature(bumpy, around.faces, corners(around.scaled(u)).angles)
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_flips_leave_the_boundary_alone(bumpy):
    t = Triangulation.of(bumpy)
    delaunay, _ = intrinsic_delaunay(t)

    def boundary(s):
        return sorted(zip(s.tails.ravel()[s.glue < 0], s.log_lengths.ravel()[s.glue < 0], strict=True))

    assert boundary(delaunay) == boundary(t)


@pytest.mark.parametrize("scale", [-400.0, 0.0, 400.0])
def test_angles_sum_to_pi_in_valid_broken_and_tiny_triangles(scale):
    log_lengths = np.log([[3.0, 4.0, 5.0], [1.0, 1.0, 1e-9], [1.0, 2.0, 4.0], [1.0, 1.0, 2.0]]) + scale
    at = corners(log_lengths)
    np.testing.assert_allclose(at.angles.sum(axis=1), np.pi, rtol=1e-14)
    np.testing.assert_array_equal(at.broken, [False, False, True, True])
    np.testing.assert_allclose(at.angles[0], np.arccos([0.8, 0.6, 0.0]), rtol=1e-12)
    np.testing.assert_array_equal(at.angles[2], [0, 0, np.pi])
    np.testing.assert_array_equal(at.half_cotangents[2:], 0)
    np.testing.assert_allclose(at.half_cotangents[0], 0.5 / np.tan(at.angles[0]), atol=1e-12)
