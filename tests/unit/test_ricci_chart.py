import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci import FlatTriangulation, RicciOptions, faces_around, lay_out, solve
from drl_meshgen.ricci.triangulation import Triangulation
from tests.ricci_shapes import annulus, bumpy_disk, planar_disk


def metric_of(surface: TriMesh) -> FlatTriangulation:
    t = Triangulation.of(surface)
    return FlatTriangulation(t.faces, np.exp(t.log_lengths), t.glue)


def similarity_residual(source: np.ndarray, image: np.ndarray) -> tuple[complex, float]:
    """Best map z -> a z + b without reflection, and its largest error."""
    z, w = source @ [1, 1j], image @ [1, 1j]
    matrix = np.c_[z, np.ones(len(z))]
    coefficients, *_ = np.linalg.lstsq(matrix, w, rcond=None)
    return coefficients[0], float(np.abs(matrix @ coefficients - w).max())


@pytest.fixture(scope="module")
def plane():
    return planar_disk(40)


def test_a_flat_surface_is_laid_out_as_it_was(plane):
    chart = lay_out(metric_of(plane))
    factor, error = similarity_residual(plane.vertices[:, :2], chart.vertices)
    assert abs(factor) == pytest.approx(1, rel=1e-12)
    assert error < 1e-12
    assert chart.closing_error < 1e-11
    assert not chart.inverted.any()


def test_a_region_has_its_own_scale(plane):
    region = np.nonzero(plane.corners[:, :, 0].mean(axis=1) > 0)[0]
    chart = lay_out(metric_of(plane), region, u_ref=-3.0)
    used = np.unique(plane.triangles[region])
    factor, error = similarity_residual(plane.vertices[used, :2], chart.vertices[used])
    assert abs(factor) == pytest.approx(np.exp(3.0), rel=1e-12)
    assert error < 1e-10
    np.testing.assert_array_equal(chart.faces, region)
    assert np.isnan(np.delete(chart.vertices, used, axis=0)).all()


def test_a_flat_ring_closes(plane):
    middle = np.hypot(*plane.corners.mean(axis=1)[:, :2].T)
    chart = lay_out(metric_of(plane), np.nonzero(middle > 0.5)[0])
    assert chart.closing_error < 1e-11


def test_the_smallest_face_lies_at_the_origin(plane):
    chart = lay_out(metric_of(plane))
    smallest = plane.areas.argmin()
    np.testing.assert_array_equal(chart.corners[smallest, 0], 0)
    assert chart.corners[smallest, 1, 1] == 0
    assert chart.corners[smallest, 1, 0] > 0


def test_curvature_shows_as_a_closing_error():
    assert lay_out(metric_of(bumpy_disk(20, 0, 0.8))).closing_error > 0.1


@pytest.mark.parametrize("boundary", ["free", "disk"])
def test_the_flat_metric_of_a_bumpy_disk_closes_without_inversions(boundary):
    result = solve(bumpy_disk(60, 1, 0.8), RicciOptions(boundary=boundary))
    chart = lay_out(result.triangulation)
    assert chart.closing_error < 1e-7
    assert not chart.inverted.any()


def test_the_disk_target_puts_the_boundary_on_a_circle():
    surface = bumpy_disk(60, 1, 0.8)
    rim = lay_out(solve(surface, RicciOptions(boundary="disk")).triangulation).vertices[surface.topology.loops[0]]
    solution, *_ = np.linalg.lstsq(np.c_[2 * rim, np.ones(len(rim))], (rim**2).sum(axis=1), rcond=None)
    radius = np.linalg.norm(rim - solution[:2], axis=1)
    np.testing.assert_allclose(radius, radius.mean(), rtol=1e-9)


def test_sides_keep_their_lengths_in_the_chart():
    result = solve(bumpy_disk(40, 2, 0.6))
    p = lay_out(result.triangulation, u_ref=-1.0).corners
    lengths = np.linalg.norm(p[:, [2, 0, 1]] - p[:, [1, 2, 0]], axis=2)
    np.testing.assert_allclose(lengths, np.e * result.triangulation.lengths, rtol=1e-9)


def test_around_a_hole_that_turns_the_chart_does_not_close():
    cone = annulus(24, height=0.0)
    tilted = TriMesh(np.c_[cone.vertices[:, :2], np.hypot(*cone.vertices[:, :2].T)], cone.triangles)
    assert lay_out(solve(tilted).triangulation).closing_error > 0.1


def test_faces_around_vertices_are_their_stars(plane):
    star = faces_around(metric_of(plane), np.array([50]))
    np.testing.assert_array_equal(star, np.nonzero((plane.triangles == 50).any(axis=1))[0])


def test_a_disconnected_region_is_refused(plane):
    apart = np.nonzero(np.abs(plane.corners[:, :, 0].mean(axis=1)) > 0.5)[0]
    with pytest.raises(ValueError, match="connected"):
        lay_out(metric_of(plane), apart)


def test_no_faces_and_broken_triangles_are_refused(plane):
    metric = metric_of(plane)
    with pytest.raises(ValueError, match="at least one face"):
        lay_out(metric, np.array([], np.int64))
    lengths = metric.lengths.copy()
    lengths[7, 0] = lengths[7].sum()
    with pytest.raises(ValueError, match=r"faces \[7\]"):
        lay_out(FlatTriangulation(metric.faces, lengths, metric.glue))
