import numpy as np
import pytest

from drl_meshgen.errors import StageError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci import Outcome, RicciOptions, distortion, solve
from drl_meshgen.ricci.flow import vertex_curvature
from drl_meshgen.ricci.hessian import Pattern
from drl_meshgen.ricci.target import InscribedDisk
from drl_meshgen.ricci.triangulation import Triangulation, corners, intrinsic_delaunay
from tests.ricci_shapes import annulus, bumpy_disk, icosahedron, planar_disk, spherical_cap, three_sided_tube

BOTH = pytest.mark.parametrize("boundary", ["free", "disk"])


@pytest.fixture(scope="module")
def bumpy():
    return bumpy_disk(60, seed=1, height=0.8)


@pytest.mark.parametrize("degrees", [30, 90, 150, 178])
def test_spherical_caps_give_the_stereographic_projection(degrees):
    surface, exact = spherical_cap(40, degrees)
    result = solve(surface)
    assert result.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(result.u, exact, atol=1e-9)


@BOTH
def test_a_flat_disk_stays_as_it_is(boundary):
    result = solve(planar_disk(30), RicciOptions(boundary=boundary))
    np.testing.assert_allclose(result.u, 0, atol=1e-10)


@BOTH
def test_inside_the_metric_is_flat_and_every_triangle_valid(bumpy, boundary):
    result = solve(bumpy, RicciOptions(boundary=boundary))
    inside = ~bumpy.topology.on_boundary
    assert np.abs(result.curvature[inside]).max() < 1e-10
    assert result.error < 1e-10
    assert not corners(np.log(result.triangulation.lengths)).broken.any()


@BOTH
def test_curvature_sums_to_two_pi_times_euler_at_every_step(bumpy, boundary):
    history = solve(bumpy, RicciOptions(boundary=boundary)).history
    assert len(history) > 2
    np.testing.assert_allclose(history["total_curvature"], 2 * np.pi, atol=1e-11)


def test_gauss_bonnet_holds_with_two_loops_and_u_vanishes_on_both():
    surface = annulus(24)
    result = solve(surface)
    np.testing.assert_allclose(result.history["total_curvature"], 0, atol=1e-11)
    np.testing.assert_array_equal(result.u[surface.topology.on_boundary], 0)


def test_the_free_boundary_keeps_its_length_and_prescribes_nothing_there(bumpy):
    result = solve(bumpy)
    on_boundary = bumpy.topology.on_boundary
    np.testing.assert_array_equal(result.u[on_boundary], 0)
    np.testing.assert_array_equal(result.target[on_boundary], result.curvature[on_boundary])


def test_the_disk_target_bends_each_boundary_edge_by_its_share_of_the_circle(bumpy):
    result = solve(bumpy, RicciOptions(boundary="disk"))
    loop = bumpy.topology.loops[0]
    assert result.target[loop].sum() == pytest.approx(2 * np.pi, rel=1e-12)
    assert (result.target[loop] > 0).all()
    assert np.ptp(result.u[loop]) > 0.01


@BOTH
def test_newton_uses_the_exact_derivative_of_the_residual(boundary):
    surface = bumpy_disk(24, seed=5, height=0.6)
    t, _ = intrinsic_delaunay(Triangulation.of(surface))
    n = len(surface.vertices)
    rng = np.random.default_rng(0)
    u, direction = rng.normal(0, 0.05, (2, n))
    free = np.arange(n) if boundary == "disk" else np.nonzero(~surface.topology.on_boundary)[0]
    direction[np.setdiff1d(np.arange(n), free)] = 0
    target = InscribedDisk(free, t, n)

    def residual(u):
        curvature = vertex_curvature(surface, t.faces, corners(t.scaled(u)).angles)[free]
        return curvature - target.curvature(t, u) if boundary == "disk" else curvature

    h = 1e-6
    change = (residual(u + h * direction) - residual(u - h * direction)) / (2 * h)
    pattern, at = Pattern.of(t, free, n), corners(t.scaled(u))
    if boundary == "free":
        weight = at.half_cotangents.ravel()
        np.testing.assert_allclose(pattern.matrix(weight, -weight) @ direction[free], change, atol=1e-7)
    else:
        step, _ = target.step(pattern, t, at, u, -change)
        back = np.zeros(n)
        back[free] = step
        again = (residual(u + h * back) - residual(u - h * back)) / (2 * h)
        np.testing.assert_allclose(again, change, atol=1e-5 * np.abs(change).max())


def test_the_hessian_sums_two_edges_between_the_same_vertices():
    t = Triangulation(np.array([[0, 1, 2], [0, 2, 1]]), np.array([3, -1, -1, 0, -1, -1]), np.zeros((2, 3)))
    free = np.arange(3)
    weight = corners(t.log_lengths).half_cotangents.ravel()
    matrix = Pattern.of(t, free, 3).matrix(weight, -weight).toarray()
    np.testing.assert_allclose(matrix, 2 * weight[0] * (3 * np.eye(3) - 1), rtol=1e-14)


@BOTH
def test_u_does_not_depend_on_position_rotation_or_scale(bumpy, boundary):
    options = RicciOptions(boundary=boundary)
    q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    moved = TriMesh(1e6 * bumpy.vertices @ q.T + 1e6, bumpy.triangles)
    np.testing.assert_allclose(solve(moved, options).u, solve(bumpy, options).u, atol=1e-8)


@BOTH
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_any_unit_of_length_works(bumpy, boundary, scale):
    result = solve(TriMesh(scale * bumpy.vertices, bumpy.triangles), RicciOptions(boundary=boundary))
    assert result.outcome is Outcome.CONVERGED


@BOTH
def test_renumbering_vertices_and_faces_renumbers_u(bumpy, boundary):
    options = RicciOptions(boundary=boundary)
    rng = np.random.default_rng(4)
    old_of_new = rng.permutation(len(bumpy.vertices))
    triangles = np.argsort(old_of_new)[bumpy.triangles][rng.permutation(len(bumpy.triangles))]
    turned = np.take_along_axis(triangles, (np.arange(3) + rng.integers(0, 3, (len(triangles), 1))) % 3, axis=1)
    found = solve(TriMesh(bumpy.vertices[old_of_new], turned), options).u
    np.testing.assert_allclose(found, solve(bumpy, options).u[old_of_new], atol=1e-8)


@BOTH
def test_reruns_are_byte_identical(bumpy, boundary):
    first, second = (solve(bumpy, RicciOptions(boundary=boundary)) for _ in range(2))
    assert first.u.tobytes() == second.u.tobytes()
    assert first.triangulation.lengths.tobytes() == second.triangulation.lengths.tobytes()
    assert first.history.equals(second.history)


def test_distortion_is_the_mean_relative_stretch_of_a_vertex_s_edges(bumpy):
    u = np.random.default_rng(6).normal(size=len(bumpy.vertices))
    stretch = {tuple(e): np.exp(u[e].mean()) for e in bumpy.topology.edges}
    largest = max(stretch.values())
    found = distortion(bumpy, u)
    for v in (0, 17, 100):
        around = [s / largest for e, s in stretch.items() if v in e]
        assert found[v] == pytest.approx(np.mean(around), rel=1e-12)


def test_vertices_without_a_triangle_are_ignored(bumpy):
    more = TriMesh(np.r_[bumpy.vertices, [[9.0, 9.0, 9.0]]], bumpy.triangles)
    result = solve(more)
    np.testing.assert_allclose(result.u[:-1], solve(bumpy).u, atol=1e-12)
    assert result.u[-1] == 0
    assert result.curvature[-1] == 0
    assert np.isnan(result.distortion[-1])


def test_a_closed_surface_is_refused():
    with pytest.raises(StageError, match="no boundary") as caught:
        solve(icosahedron())
    assert caught.value.outcome is Outcome.CLOSED


@pytest.mark.parametrize("surface", [annulus(12), three_sided_tube(4)])
def test_the_disk_target_is_refused_where_there_are_two_loops(surface):
    with pytest.raises(StageError, match="2 loops") as caught:
        solve(surface, RicciOptions(boundary="disk"))
    assert caught.value.outcome is Outcome.NOT_A_DISK


def test_running_out_of_steps_raises_unless_asked_not_to(bumpy):
    options = RicciOptions(max_steps=1)
    with pytest.raises(StageError, match="limit of Newton steps"):
        solve(bumpy, options)
    result = solve(bumpy, options, throw=False)
    assert result.outcome is Outcome.MAX_STEPS
    assert not result.usable


def test_without_flips_the_convex_extension_still_gets_the_curvature_and_reports_broken_triangles():
    surface = bumpy_disk(60, seed=1, height=1.5)
    result = solve(surface, RicciOptions(flips=False), throw=False)
    assert result.outcome is Outcome.BROKEN
    assert result.error < 1e-10
    assert result.history["broken"].iloc[-1] > 0
    assert result.history["flips"].sum() == 0
    np.testing.assert_array_equal(result.triangulation.faces, surface.triangles)
    assert solve(surface).outcome is Outcome.CONVERGED


def test_an_edge_without_length_is_named(bumpy):
    vertices = bumpy.vertices.copy()
    first, second = bumpy.topology.edges[40]
    vertices[second] = vertices[first]
    with pytest.raises(ValueError, match=rf"\[\[{first}, {second}\]\]"):
        solve(TriMesh(vertices, bumpy.triangles))


@pytest.mark.parametrize("values", [{"boundary": "open"}, {"tolerance": 1e-7}, {"tolerance": 0.0}])
def test_options_out_of_range_are_refused(values):
    with pytest.raises(ValueError, match=next(iter(values))):
        RicciOptions(**values)
