import numpy as np
import pytest

from drl_meshgen.templates.curves import LINE_TYPES, STRAIGHT, graded, offsets, sample
from drl_meshgen.templates.tfi import arc_fractions, parameters, transfinite

CORNERS = np.array([[0.2, -0.1], [3.0, 0.4], [2.5, 2.0], [-0.5, 1.5]])


def bilinear(u, v):
    a, b, c, d = CORNERS
    u, v = np.asarray(u)[..., None], np.asarray(v)[..., None]
    return (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d


def rims(u, v):
    return bilinear(u, 0 * u), bilinear(u, 0 * u + 1), bilinear(0 * v, v), bilinear(0 * v + 1, v)


def test_bilinear_maps_are_reproduced_exactly():
    u, v = np.linspace(0, 1, 7), np.linspace(0, 1, 5)
    grid = transfinite(*rims(u, v))
    assert grid == pytest.approx(bilinear(*np.meshgrid(u, v, indexing="ij")), abs=1e-14)


def test_bilinear_maps_are_reproduced_for_graded_sides_by_arc_length():
    u, v = graded(6, 1.4), graded(4, 0.7)
    curves = rims(u, v)
    grid = transfinite(*curves, fractions=tuple(arc_fractions(c) for c in curves))
    assert grid == pytest.approx(bilinear(*np.meshgrid(u, v, indexing="ij")), abs=1e-14)


def test_the_rim_of_the_patch_is_the_four_curves():
    rng = np.random.default_rng(0)
    u, v = np.linspace(0, 1, 6), np.linspace(0, 1, 4)
    bottom, top, left, right = (c + rng.normal(0, 0.05, c.shape) for c in rims(u, v))
    left[0], left[-1], right[0], right[-1] = bottom[0], top[0], bottom[-1], top[-1]
    grid = transfinite(bottom, top, left, right)
    for rim, curve in zip((grid[:, 0], grid[:, -1], grid[0], grid[-1]), (bottom, top, left, right), strict=True):
        assert np.array_equal(rim, curve)


def test_blending_lines_meet_where_the_sides_are_divided():
    bottom, top, left, right = graded(5, 1.3), graded(5, 0.8), graded(3, 1.1), graded(3, 0.6)
    u, v = parameters(bottom, top, left, right)
    assert u == pytest.approx(bottom[:, None] + v * (top - bottom)[:, None])
    assert v == pytest.approx(left + u * (right - left))


def test_graded_steps_change_by_the_ratio():
    steps = np.diff(graded(6, 1.25))
    assert steps[1:] / steps[:-1] == pytest.approx(np.full(5, 1.25))
    assert steps.sum() == pytest.approx(1)


@pytest.mark.parametrize("bulge", LINE_TYPES.tolist())
def test_every_line_type_joins_its_ends_and_bulges_by_its_amplitude(bulge):
    start, end = np.array([1.0, 2.0]), np.array([4.0, 6.0])
    t = np.linspace(0, 1, 2001)
    curve = sample(start, end, offsets(start, end, np.array(bulge)), t)
    assert np.array_equal(curve[0], start)
    assert np.array_equal(curve[-1], end)
    height = (curve - start) @ np.array([-4.0, 3.0]) / 5 / 5
    if 0 in bulge:
        assert abs(height).max() == pytest.approx(max(map(abs, bulge)), abs=1e-6)


def test_line_types_are_distinct_and_the_first_is_straight():
    assert len(np.unique(LINE_TYPES, axis=0)) == len(LINE_TYPES) >= 10
    assert not LINE_TYPES[STRAIGHT].any()


def test_line_types_come_in_mirrored_pairs():
    table = {tuple(row) for row in LINE_TYPES.tolist()}
    assert {(-a, -b) for a, b in table} == table
