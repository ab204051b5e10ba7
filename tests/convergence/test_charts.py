"""Charts converge to the conformal maps of the smooth surfaces they triangulate."""

import numpy as np
import pytest

from drl_meshgen.decompose.spine import loop_distances
from drl_meshgen.lift.harmonic import ring_chart
from tests.chains import tube


def annulus_chart(around, outer=2.0):
    """Flat annulus between radii 1 and `outer`: its conformal coordinates are log r / log(outer) and the angle."""
    rows = around // 8
    mesh = tube(around, rows, np.linspace(outer, 1, rows + 1), np.zeros(rows + 1))
    chart = ring_chart(mesh, np.arange(around), rows * around + np.arange(around))
    radius = np.linalg.norm(mesh.vertices, axis=1)
    return mesh, chart, 1 - np.log(radius) / np.log(outer)


def rate(errors):
    return np.log2(errors[0] / errors[-1]) / (len(errors) - 1)


def test_modulus_of_a_planar_annulus_converges_with_second_order():
    errors = [abs(annulus_chart(n)[1].modulus - np.log(2) / (2 * np.pi)) for n in (32, 64, 128)]
    assert rate(errors) > 1.8, errors


def test_height_of_a_planar_annulus_converges_with_second_order():
    errors = []
    for n in (16, 32, 64):
        _, chart, exact = annulus_chart(n)
        errors.append(np.abs(chart.h - exact).max())
    assert errors[-1] < 1e-3
    assert rate(errors) > 1.8, errors


def test_theta_of_a_planar_annulus_is_its_angle():
    mesh, chart, _ = annulus_chart(32)
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0]) / (2 * np.pi)
    turn = chart.theta - angle - (chart.theta - angle)[0]
    np.testing.assert_allclose(turn, np.round(turn), atol=1e-9)


def test_modulus_of_a_surface_of_revolution_converges_to_its_integral():
    """Conformal height of a surface of revolution: integral of ds / r over 2 pi."""

    def profile(n):
        z = np.linspace(0, 2, n + 1)
        return 1 + 0.3 * np.sin(2 * z), z

    r, z = profile(20000)
    ds = np.hypot(np.diff(r), np.diff(z))
    exact = (ds / ((r[1:] + r[:-1]) / 2)).sum() / (2 * np.pi)
    errors = []
    for around in (25, 50, 100):
        rows = round(0.36 * around)
        mesh = tube(around, rows, *profile(rows))
        chart = ring_chart(mesh, np.arange(around), rows * around + np.arange(around))
        errors.append(abs(chart.modulus - exact))
    assert rate(errors) > 1.8, errors


@pytest.mark.parametrize("loop", [0, 1])
def test_smooth_distance_to_a_loop_orders_points_as_the_distance_does(loop):
    around, rows = 40, 40
    mesh = tube(around, rows, np.ones(rows + 1), np.linspace(0, 5, rows + 1))
    loops = (np.arange(around), rows * around + np.arange(around))
    distance = loop_distances(mesh, loops)[:, loop].reshape(rows + 1, around)
    exact = np.linspace(0, 5, rows + 1)
    exact = exact[::-1] if loop else exact
    np.testing.assert_allclose(distance, distance[:, :1].repeat(around, axis=1), atol=1e-9)
    assert (np.diff(distance[:, 0]) * np.diff(exact) > 0).all()
    near = exact < 4
    np.testing.assert_allclose(distance[near, 0], exact[near], rtol=0.05, atol=0.05)
