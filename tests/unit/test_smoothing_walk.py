import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.smoothing.curves import CurveTrack
from drl_meshgen.smoothing.nodes import tangent_frame
from drl_meshgen.smoothing.walk import SurfaceWalker


def square(n=6, *, fold=0.0):
    """Unit square of n x n cells in two triangles each, bent about the line x = 1/2 by the angle `fold`."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    over = np.maximum(x - 0.5, 0)
    points = np.stack([np.minimum(x, 0.5) + np.cos(fold) * over, y, np.sin(fold) * over], axis=-1).reshape(-1, 3)
    id_ = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (g.ravel() for g in (id_[:-1, :-1], id_[1:, :-1], id_[1:, 1:], id_[:-1, 1:]))
    return TriMesh(points, np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))


def starts(surface, n=50, seed=0):
    rng = np.random.default_rng(seed)
    triangle = rng.integers(0, len(surface.triangles), n)
    weights = rng.dirichlet([1, 1, 1], n)
    return triangle, weights, rng


def test_walk_in_a_plane_is_addition_where_it_stays_inside():
    surface = square()
    walker = SurfaceWalker(surface)
    triangle, weights, rng = starts(surface)
    start = walker.positions(triangle, weights)
    step = np.c_[rng.uniform(-0.4, 0.4, (50, 2)), np.zeros(50)]
    inside = ((start + step)[:, :2] > 0).all(axis=1) & ((start + step)[:, :2] < 1).all(axis=1)
    assert inside.sum() > 10
    end = walker.positions(*walker.walk(triangle, weights, step))
    assert np.allclose(end[inside], (start + step)[inside], atol=1e-12)


def test_walk_over_a_fold_is_the_walk_on_the_unfolded_paper():
    flat, bent = square(), square(fold=1.1)
    triangle, weights, rng = starts(flat, seed=1)
    step = np.c_[rng.uniform(-0.3, 0.3, (50, 2)), np.zeros(50)]
    on_right = flat.corners[triangle].mean(axis=1)[:, 0] > 0.5
    turn = np.array([[np.cos(1.1), 0, np.sin(1.1)], [0, 1, 0], [-np.sin(1.1), 0, np.cos(1.1)]])
    found = SurfaceWalker(flat).walk(triangle, weights, step)
    folded = SurfaceWalker(bent).walk(triangle, weights, np.where(on_right[:, None], step @ turn, step))
    assert np.array_equal(found[0], folded[0])
    assert np.allclose(found[1], folded[1], atol=1e-10)


def test_walk_stops_at_the_boundary():
    surface = square()
    walker = SurfaceWalker(surface)
    triangle, weights, _ = starts(surface)
    end = walker.positions(*walker.walk(triangle, weights, np.tile([5.0, 0, 0], (50, 1))))
    assert np.allclose(end[:, 0], 1)


def test_walk_and_back_returns_to_the_start():
    surface = square()
    walker = SurfaceWalker(surface)
    triangle, weights = np.array([0, 30]), np.full((2, 3), 1 / 3)
    step = np.array([[0.3, 0.2, 0], [-0.1, 0.15, 0]])
    there = walker.walk(triangle, weights, step)
    back = walker.walk(*there, -step)
    assert np.allclose(walker.positions(*back), walker.positions(triangle, weights))


def test_locate_inverts_positions():
    surface = square(fold=0.7)
    walker = SurfaceWalker(surface)
    triangle, weights, _ = starts(surface)
    assert np.allclose(walker.locate(triangle, walker.positions(triangle, weights)), weights)


def test_boundary_projection_of_boundary_points_is_exact():
    surface = square(fold=0.7)
    track = CurveTrack(SurfaceWalker(surface))
    s = np.linspace(0, track.length[0], 40, endpoint=False)
    loop = np.zeros(40, np.int64)
    triangle, weights, direction = track.locate(loop, s)
    points = SurfaceWalker(surface).positions(triangle, weights)
    assert np.allclose(track.project(points, loop[:1])[1], s)
    assert np.allclose(np.linalg.norm(direction, axis=1), 1)


def test_boundary_coordinates_wrap_around_the_loop():
    track = CurveTrack(SurfaceWalker(square()))
    assert track.length[0] == pytest.approx(4)
    assert track.wrap(np.zeros(2, np.int64), np.array([-0.5, 4.25])) == pytest.approx([3.5, 0.25])


def test_tangent_frames_are_orthonormal_and_right_handed():
    normals = np.random.default_rng(0).normal(size=(100, 3))
    normals = np.r_[normals / np.linalg.norm(normals, axis=1, keepdims=True), [[0, 0, 1], [0, 0, -1]]]
    first, second = tangent_frame(normals)
    assert np.allclose(np.cross(first, second), normals)
    assert np.allclose(np.linalg.norm(first, axis=1), 1)
