import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.templates import Domain


def circle(count=12):
    angle = 2 * np.pi * np.arange(count) / count
    return np.c_[np.cos(angle), np.sin(angle)]


def test_turning_angles_sum_to_a_full_turn():
    nodes = circle(30) * [2, 1] + 0.2 * np.sin(3 * np.arange(30))[:, None] * [0, 0.1]
    assert Domain(nodes).turning.sum() == pytest.approx(2 * np.pi)


def test_curvature_of_a_fine_circle_is_its_reciprocal_radius():
    assert Domain(5 * circle(200)).curvature == pytest.approx(np.full(200, 0.2), rel=1e-3)


def test_the_frame_has_the_area_of_the_unit_disk_and_its_centroid_at_the_origin():
    domain = Domain(3 * circle(16) + [4, -7])
    local = Domain(domain.frame.to_local(domain.nodes))
    assert local.area == pytest.approx(np.pi)
    assert local.nodes.mean(axis=0) == pytest.approx([0, 0], abs=1e-12)
    assert domain.frame.to_world(local.nodes) == pytest.approx(domain.nodes)


def test_nodes_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        Domain(circle()).nodes[0] = 0


def test_clockwise_input_is_refused_and_turned_on_request_with_node_zero_first():
    clockwise = circle()[::-1]
    with pytest.raises(InputError, match="clockwise"):
        Domain(clockwise)
    turned = Domain.oriented(clockwise)
    assert turned.area > 0
    assert np.array_equal(turned.nodes[0], clockwise[0])
    assert np.array_equal(turned.nodes[1], clockwise[-1])


def swapped(i, j):
    nodes = circle()
    nodes[[i, j]] = nodes[[j, i]]
    return nodes


def repeated():
    nodes = circle()
    nodes[5] = nodes[2]
    return nodes


def not_a_number():
    nodes = circle()
    nodes[3, 1] = np.nan
    return nodes


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        (swapped(2, 7), "cross"),
        (swapped(2, 3), "cross"),
        (repeated(), "points 2 and 5 coincide"),
        (not_a_number(), "point 3 is not finite"),
        (circle(7), "7 points"),
        (np.zeros((9, 3)), "shape"),
        (np.c_[np.arange(10.0), np.zeros(10)], "cross or touch"),
    ],
)
def test_bad_boundaries_are_named(nodes, message):
    with pytest.raises(InputError, match=message):
        Domain(nodes)
    with pytest.raises(InputError, match=message):
        Domain.oriented(nodes)
