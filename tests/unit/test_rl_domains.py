import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.errors import InputError
from drl_meshgen.rl import FAMILIES, DataSet, Difficulty, drawn_domain, read_samples, samples_of, write_samples
from drl_meshgen.rl.domains import LEAST_GAP, resampled, rounded

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(Difficulty), st.integers(0, 10_000), st.integers(12, 150).map(lambda half: 2 * half))
def test_domains_are_even_centred_and_as_large_as_the_unit_disk(difficulty, seed, count):
    domain, family = drawn_domain(difficulty, np.random.default_rng(seed), count)
    assert len(domain) == count
    assert family in {one.name for one in FAMILIES[difficulty]}
    assert domain.area == pytest.approx(np.pi)
    assert domain.frame.origin == pytest.approx(np.zeros(2), abs=1e-12)
    assert domain.lengths.max() < 1.1 * domain.lengths.mean()  # chords of equal arcs: shorter at corners only


@pytest.mark.parametrize("difficulty", Difficulty)
def test_parts_of_the_boundary_that_face_one_another_have_room_for_quads(difficulty):
    for seed in range(20):
        nodes = drawn_domain(difficulty, np.random.default_rng(seed), 100)[0].nodes
        spacing = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1).mean()
        distance = np.linalg.norm(nodes[:, None] - nodes, axis=2)
        apart = np.abs(np.subtract.outer(np.arange(100), np.arange(100)))
        far = np.minimum(apart, 100 - apart) >= 4 * LEAST_GAP
        assert distance[far].min() >= LEAST_GAP * spacing


@pytest.mark.parametrize("difficulty", Difficulty)
def test_shares_of_families_sum_to_one(difficulty):
    assert sum(one.share for one in FAMILIES[difficulty]) == pytest.approx(1)


@pytest.mark.parametrize("count", [11, 6, 25])
def test_odd_or_few_nodes_are_refused(count):
    with pytest.raises(InputError, match="take an even number"):
        drawn_domain(Difficulty.STANDARD, np.random.default_rng(0), count)


def test_where_no_curve_fits_a_sentence_says_so(monkeypatch):
    monkeypatch.setattr("drl_meshgen.rl.domains.MOST_DRAWS", 0)
    with pytest.raises(InputError, match="no hard domain of 24 nodes"):
        drawn_domain(Difficulty.HARD, np.random.default_rng(0), 24)


def test_a_domain_does_not_depend_on_those_drawn_before():
    alone = next(samples_of(DataSet.TEST_HARD, [3]))
    among = list(samples_of(DataSet.TEST_HARD, range(5)))[3]
    assert np.array_equal(alone.domain.nodes, among.domain.nodes)
    assert (alone.index, alone.family) == (among.index, among.family)


def test_no_domain_is_in_two_sets():
    first = {one.domain.nodes.tobytes() for data in DataSet for one in samples_of(data, range(3))}
    assert len(first) == 3 * len(DataSet)


def test_counts_of_nodes_vary_by_a_fifth():
    counts = [len(one.domain) for one in samples_of(DataSet.VALIDATION, range(60))]
    assert min(counts) >= 80
    assert max(counts) <= 120
    assert len(set(counts)) > 10


def test_samples_survive_a_parquet_file_and_give_the_same_bytes(tmp_path):
    samples = list(samples_of(DataSet.TEST_STANDARD, range(3)))
    write_samples(tmp_path / "a.parquet", samples)
    write_samples(tmp_path / "b.parquet", list(samples_of(DataSet.TEST_STANDARD, range(3))))
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    for one, other in zip(samples, read_samples(tmp_path / "a.parquet"), strict=True):
        assert np.array_equal(one.domain.nodes, other.domain.nodes)
        assert (one.set, one.index, one.family) == (other.set, other.index, other.family)


def test_resampling_puts_points_at_equal_arc_length():
    points = resampled(SQUARE, 8)
    assert points == pytest.approx(np.array([[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1], [0, 0.5]]))


def test_rounding_cuts_the_corners_of_a_square_and_keeps_its_sides_and_centre():
    curve = rounded(SQUARE, 0.1)
    assert curve.min() == pytest.approx(0, abs=1e-12)
    assert curve.max() == pytest.approx(1, abs=1e-12)
    assert np.abs(curve - 0.5).max(axis=1).min() > 0.4
    assert np.linalg.norm(curve - 0.5, axis=1).max() < np.sqrt(0.5) - 0.05
    assert curve.mean(axis=0) == pytest.approx([0.5, 0.5], abs=0.02)
