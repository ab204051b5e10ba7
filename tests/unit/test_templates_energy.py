import numpy as np
import pytest

from drl_meshgen.templates.energy import Corners, corner_energy, corner_operator, total_energy

SQUARE = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])
QUAD = np.array([[0, 1, 2, 3]])


def rhombus(angle):
    return np.array([[0, 0], [1, 0], [1 + np.cos(angle), np.sin(angle)], [np.cos(angle), np.sin(angle)]])


def test_the_wanted_cell_has_the_least_energy():
    edges = corner_operator(QUAD, 4) @ SQUARE
    side = np.full(4, 2.0)
    energy = corner_energy(edges, Corners.wanted(side, side), 0.3, 1e-9)
    assert energy == pytest.approx(np.full(4, 1.3))
    _, slope = total_energy(edges, Corners.wanted(side, side), np.ones(4), 0.3, 1e-9)
    assert abs(slope).max() < 1e-12


def test_a_wanted_angle_is_met_by_a_rhombus_of_that_angle():
    angle = 1.2
    edges = corner_operator(QUAD, 4) @ rhombus(angle)
    wanted = np.array([angle, np.pi - angle] * 2)
    assert corner_energy(edges, Corners.wanted(np.ones(4), np.ones(4), wanted), 0.0, 1e-9) == pytest.approx(np.ones(4))


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_the_gradient_agrees_with_differences_for_valid_and_folded_cells(flip):
    rng = np.random.default_rng(0)
    points = SQUARE * [flip, 1] + rng.normal(0, 0.3, (4, 2))
    operator = corner_operator(QUAD, 4)
    corners = Corners.wanted(rng.uniform(1, 2, 4), rng.uniform(1, 2, 4), rng.uniform(1, 2, 4))
    weight = rng.uniform(size=4)

    def value(p):
        return total_energy(operator @ p, corners, weight, 0.3, 0.1)[0]

    slope = operator.T @ total_energy(operator @ points, corners, weight, 0.3, 0.1)[1]
    for i, j in np.ndindex(4, 2):
        step = np.zeros((4, 2))
        step[i, j] = 1e-6
        assert slope[i, j] == pytest.approx((value(points + step) - value(points - step)) / 2e-6, rel=1e-6, abs=1e-7)


def test_energy_is_invariant_under_rotation_and_common_scale():
    c, s = np.cos(0.7), np.sin(0.7)
    points = SQUARE + np.random.default_rng(1).normal(0, 0.2, (4, 2))
    operator = corner_operator(QUAD, 4)
    before = corner_energy(operator @ points, Corners.wanted(np.ones(4), np.ones(4)), 0.3, 0.1)
    turned = 5 * points @ np.array([[c, s], [-s, c]])
    after = corner_energy(operator @ turned, Corners.wanted(5 * np.ones(4), 5 * np.ones(4)), 0.3, 0.1)
    assert after == pytest.approx(before)
