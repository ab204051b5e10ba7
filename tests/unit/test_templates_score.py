import numpy as np
import pytest

from drl_meshgen.templates import score

QUAD = np.array([[0, 1, 2, 3]])
SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def rhombus(angle):
    return np.array([[0, 0], [1, 0], [1 + np.cos(angle), np.sin(angle)], [np.cos(angle), np.sin(angle)]])


def test_a_rectangle_scores_one_in_everything():
    points = SQUARE * [7, 2]
    for figure in (score.orthogonality, score.orthogonality_printed, score.jacobian_ratio):
        assert figure(points, QUAD) == pytest.approx([1])
    assert score.reward(points, QUAD) == pytest.approx(0.8)


def test_orthogonality_falls_linearly_with_the_angle_of_a_rhombus():
    for angle in (0.5, 1.0, 2.0):
        expected = 1 - 2 / np.pi * abs(np.pi / 2 - angle)
        assert score.orthogonality(rhombus(angle), QUAD) == pytest.approx([expected])
        assert score.orthogonality_printed(rhombus(angle), QUAD) == pytest.approx([expected])


def test_the_worst_corner_counts_and_the_printed_form_takes_the_best():
    kite = np.array([[0.0, 0], [2, 0], [1, 1], [0, 2]])
    assert score.orthogonality(kite, QUAD) == pytest.approx([0.0])
    assert score.orthogonality_printed(kite, QUAD) == pytest.approx([1.0])


def test_a_reflex_corner_scores_below_zero_and_has_no_jacobian_ratio():
    dart = np.array([[0.0, 0], [2, 0], [0.4, 0.4], [0, 2]])
    assert score.orthogonality(dart, QUAD)[0] < 0
    assert score.jacobian_ratio(dart, QUAD) == pytest.approx([0])


def test_the_jacobian_ratio_of_a_trapezoid_is_that_of_its_parallel_sides():
    trapezoid = np.array([[0.0, 0], [3, 0], [2, 1], [1, 1]])
    assert score.jacobian_ratio(trapezoid, QUAD) == pytest.approx([1 / 3])


def test_a_clockwise_quad_has_negative_jacobians():
    assert (score.jacobians(SQUARE[::-1], QUAD) < 0).all()


def test_boundary_deviation_lowers_the_reward_by_its_square():
    samples = np.c_[np.arange(5.0), np.zeros(5)]
    mse = score.boundary_mse(samples + np.array([0, 0.1]), samples)
    assert mse == pytest.approx(0.01)
    assert score.reward(SQUARE, QUAD, mse, spacing=0.5) == pytest.approx(0.8 - 0.2 * 0.01 / 0.25)


def test_figures_of_many_meshes_at_once_are_those_of_each():
    rng = np.random.default_rng(0)
    batch = SQUARE + rng.normal(0, 0.2, (6, 4, 2))
    for figure in (score.orthogonality, score.jacobian_ratio, score.reward):
        assert figure(batch, QUAD) == pytest.approx(np.array([figure(points, QUAD) for points in batch]))
