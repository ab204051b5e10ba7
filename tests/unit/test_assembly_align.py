"""Columns meet nodes: maps between theta and curves, spacing, shifts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.assembly.align import Columns, align, best_shift
from drl_meshgen.decompose.cells import LEAST_GAP, spread
from drl_meshgen.decompose.loops import LoopMap, loop_map
from tests.chains import SURFACES, chain

FEW = settings(max_examples=40, deadline=None, derandomize=True)


def rising(seed, n, start=0.0):
    steps = np.random.default_rng(seed).uniform(0.05, 1, n)
    return start + np.r_[0, np.cumsum(steps)] / steps.sum()


@FEW
@given(st.integers(0, 99), st.sampled_from([1, -1]), st.floats(-3, 3), st.integers(3, 30))
def test_loop_maps_and_their_inverses_cancel(seed, direction, start, n):
    relation = LoopMap(rising(seed, n, start), direction * rising(seed + 1, n, -start))
    assert relation.direction == direction
    theta = np.linspace(-2.3, 3.1, 57)
    position = relation.to_position(theta)
    assert (direction * np.diff(position) > 0).all()
    np.testing.assert_allclose(relation.to_theta(position), theta, atol=1e-9)
    np.testing.assert_allclose(relation.to_position(relation.theta), relation.position, atol=1e-12)


@FEW
@given(st.integers(0, 99), st.sampled_from([1, -1]))
def test_a_turn_of_theta_is_a_turn_of_the_curve(seed, direction):
    relation = LoopMap(rising(seed, 9, 0.2), direction * rising(seed + 1, 9, 0.7))
    theta = np.linspace(0, 1, 13)
    np.testing.assert_allclose(relation.to_position(theta + 2), relation.to_position(theta) + 2 * direction, atol=1e-12)
    position = np.linspace(0, 1, 13)
    np.testing.assert_allclose(relation.to_theta(position - 1), relation.to_theta(position) - direction, atol=1e-12)


@FEW
@given(st.integers(0, 99), st.integers(4, 60), st.floats(-2, 2))
def test_spread_keeps_the_least_gap_and_the_mean_place(seed, n, start):
    theta = start + np.sort(np.random.default_rng(seed).uniform(0, 1, n) ** 3)
    out = spread(theta)
    gap = np.diff(np.r_[out, out[0] + 1])
    assert gap.min() * n >= LEAST_GAP - 1e-9
    assert gap.sum() == pytest.approx(1)
    assert out.mean() == pytest.approx(theta.mean())


def test_spread_leaves_angles_that_keep_their_distance():
    theta = 0.3 + np.arange(8) / 8 + 0.01 * np.sin(np.arange(8))
    np.testing.assert_array_equal(spread(theta), theta)


@FEW
@given(st.integers(0, 99), st.integers(3, 40), st.data())
def test_best_shift_finds_a_shift_that_was_made(seed, n, data):
    wanted = rising(seed, n, 0.1)[:-1]
    shift, turns = data.draw(st.integers(0, n - 1)), data.draw(st.integers(-2, 2))
    j = np.arange(n)
    given_ = np.empty(n)
    given_[(j + shift) % n] = wanted - (j + shift) // n - turns
    m, w = best_shift(wanted, given_)
    assert (m, w) == (shift, turns)
    np.testing.assert_allclose(given_[(j + m) % n] + (j + m) // n + w, wanted, atol=1e-12)


@FEW
@given(st.integers(1, 30), st.integers(0, 29), st.sampled_from([1, -1]))
def test_columns_meet_every_node_once_in_cyclic_order(n, start, direction):
    nodes = Columns(start % n, direction, np.arange(n) / n).nodes()
    assert sorted(nodes.tolist()) == list(range(n))
    assert nodes[0] == start % n
    assert (((np.roll(nodes, -1) - nodes) * direction) % n == 1 % n).all()


@pytest.mark.parametrize("name", ["bumps", "two limbs", "four limbs", "plate with holes"])
def test_loop_maps_follow_the_arc_length_of_their_curve(name):
    run = chain(name)
    points, curves = run["partition"].surface.mesh.vertices, run["partition"].curves
    for tube in run["decompose"].pieces.tubes:
        for curve, loop in zip(tube.curves, (tube.ring.inner, tube.ring.outer), strict=True):
            relation = loop_map(tube.ring, loop, curves[curve])
            at, _ = curves[curve].arc_length(points)
            place = dict(zip(curves[curve].vertices.tolist(), at.tolist(), strict=True))
            expected = np.array([place[int(v)] for v in tube.ring.origin[loop]])
            off = relation.position[:-1] - expected
            np.testing.assert_allclose(off, np.round(off), atol=1e-9)


@pytest.mark.parametrize("name", SURFACES)
def test_nodes_of_every_curve_go_round_it_once_in_order(name):
    run = chain(name)
    placed = align(run["partition"], run["decompose"])
    assert len(placed.positions) == len(run["partition"].curves)
    for position, count in zip(placed.positions, run["decompose"].curve_counts, strict=True):
        assert len(position) == count
        gap = np.diff(np.r_[position, position[0] + 1])
        assert gap.min() > 0
        assert gap.sum() == pytest.approx(1)


@pytest.mark.parametrize("name", SURFACES)
def test_columns_of_every_ring_rise_over_one_period(name):
    run = chain(name)
    for fill in run["subdomain"].rings:
        for row in fill.chart[..., 0]:
            assert np.diff(np.r_[row, row[0] + 1]).min() > 0
        height = fill.chart[..., 1]
        assert (np.diff(height, axis=0) > 0).all()
        assert (height[0].max(), height[-1].min()) == (0, 1)
