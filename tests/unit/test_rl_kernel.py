import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.kernel import judge_c, judge_o
from drl_meshgen.templates import CCounts, CParameters, CSides, OParameters, instantiate, instantiate_c
from drl_meshgen.templates.c_type import rule_c
from drl_meshgen.templates.corners import reference
from drl_meshgen.templates.curves import LINE_TYPES
from drl_meshgen.templates.score import (
    Weights,
    corner_edges,
    jacobian_ratio,
    jacobians,
    orthogonality,
    reward,
    validity_penalty,
)


def drawn(domain, rng, count):
    """Random parameters of O-type meshes, from calm to folded."""
    half = len(domain) // 2
    corners = np.stack([rng.integers(0, half, count), rng.integers(1, half, count)], axis=1)
    singular = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) + rng.normal(0, 0.3, (count, 4, 2))
    return corners, rng.integers(1, 11, count), singular, LINE_TYPES[rng.integers(0, len(LINE_TYPES), (count, 8))]


def check(mesh, judged, b):
    points, quads = np.array(mesh.points), np.array(mesh.quads)
    side = np.linalg.norm(corner_edges(points, quads)[0], axis=-1).mean(axis=-1)
    assert judged.least[b] == pytest.approx((jacobians(points, quads).min(axis=-1) / side**2).min(), abs=1e-9)
    assert judged.valid[b] == mesh.valid
    assert judged.reward[b] == pytest.approx(float(reward(points, quads)), abs=1e-9)
    assert judged.penalty[b] == pytest.approx(float(validity_penalty(points, quads)), abs=1e-9)
    assert judged.orthogonality[b] == pytest.approx(float(orthogonality(points, quads).mean()), abs=1e-9)
    assert judged.jacobian[b] == pytest.approx(float(jacobian_ratio(points, quads).mean()), abs=1e-9)


def test_waves_and_swells_are_judged_as_their_definition_says():
    rng = np.random.default_rng(5)
    sample = next(samples_of(DataSet.TEST_STANDARD, [3]))
    corners, layers, singular, bulges = drawn(sample.domain, rng, 8)
    waves, swells = rng.normal(0, 0.03, (8, 8, 2, 2)), rng.normal(0, 0.03, (8, 4, 3, 2))
    judged = judge_o(sample.domain.nodes, corners, layers, singular, bulges, waves=waves, swells=swells)
    for b in range(8):
        i0, m = corners[b].tolist()
        n, k = len(sample.domain) // 2 - m, int(layers[b])
        given = OParameters(i0, m, n, k, singular[b], bulges[b], waves=waves[b], swells=swells[b])
        check(instantiate(sample.domain, given), judged, b)


@pytest.mark.parametrize("data", [DataSet.TEST_STANDARD, DataSet.TEST_HARD])
def test_o_type_meshes_are_judged_as_their_definition_says_valid_or_folded(data):
    rng = np.random.default_rng(0)
    for sample in samples_of(data, range(3)):
        corners, layers, singular, bulges = drawn(sample.domain, rng, 12)
        judged = judge_o(sample.domain.nodes, corners, layers, singular, bulges)
        for b in range(12):
            i0, m = corners[b].tolist()
            n = len(sample.domain) // 2 - m
            mesh = instantiate(sample.domain, OParameters(i0, m, n, int(layers[b]), singular[b], bulges[b]))
            check(mesh, judged, b)


def test_good_meshes_are_found_valid():
    sample = next(samples_of(DataSet.TEST_STANDARD, [1]))
    half = len(sample.domain) // 2
    singular = reference(4, 2)[0][32:48:4] @ sample.domain.nodes[(np.arange(16) * len(sample.domain)) // 16]
    found = judge_o(sample.domain.nodes, [[0, half // 2]], [4], singular[None], np.zeros((1, 8, 2)))
    assert found.valid.dtype == bool
    assert 0 < found.reward[0] < 0.8


def test_c_type_meshes_are_judged_as_their_definition_says():
    rng = np.random.default_rng(1)
    sample = next(samples_of(DataSet.TEST_STANDARD, [2]))
    size = len(sample.domain)
    top = size // 2 - 30
    chosen = []
    for start in (0, 7, 40):
        counts = CCounts.between(CSides(size - 30 - top, 15, top))
        rule = rule_c(sample.domain, start, counts)
        bulges = LINE_TYPES[rng.integers(0, len(LINE_TYPES), 12)]
        chosen.append(CParameters(start, counts, rule.singular + rng.normal(0, 0.02, (4, 2)), bulges))
    judged = judge_c(sample.domain.nodes, chosen)
    for b, parameters in enumerate(chosen):
        check(instantiate_c(sample.domain, parameters), judged, b)


def test_weights_weigh():
    sample = next(samples_of(DataSet.TEST_STANDARD, [0]))
    given = drawn(sample.domain, np.random.default_rng(2), 4)
    angles = judge_o(sample.domain.nodes, *given, weights=Weights(orthogonality=1.0, jacobian=0.0))
    assert np.allclose(angles.reward, 0.8 * angles.orthogonality)


def test_what_does_not_fit_is_refused():
    sample = next(samples_of(DataSet.TEST_STANDARD, [0]))
    corners, layers, singular, bulges = drawn(sample.domain, np.random.default_rng(3), 1)
    with pytest.raises(InputError, match="do not fit a boundary"):
        judge_o(sample.domain.nodes, corners * 0, layers, singular, bulges)
    with pytest.raises(InputError, match="do not fit a boundary"):
        judge_o(sample.domain.nodes[:-1], corners, layers, singular, bulges)
    with pytest.raises(InputError, match="counts do not fit"):
        judge_c(sample.domain.nodes, [CParameters(0, CCounts(1, 1, 1, 1, 1, 1), singular[0], np.zeros((12, 2)))])


def test_quads_without_size_are_judged_not_valid():
    sample = next(samples_of(DataSet.TEST_STANDARD, [0]))
    judged = judge_o(sample.domain.nodes, [[0, 20]], [3], np.zeros((1, 4, 2)), np.zeros((1, 8, 2)))
    assert not judged.valid.any()
    assert np.isfinite(judged.reward).all()
    assert np.isfinite(judged.penalty).all()
