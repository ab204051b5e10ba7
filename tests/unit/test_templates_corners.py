import numpy as np
import pytest

from drl_meshgen.templates import Domain
from drl_meshgen.templates.corners import best_per_count, corner_pairs, rank_corners, reference
from drl_meshgen.templates.options import PlacementOptions
from drl_meshgen.templates.placement import place, start_of
from drl_meshgen.templates.policy import RulePolicy, boundary_size
from drl_meshgen.templates.sketch import Sketch, subset


def crowded(count, strength):
    t = 2 * np.pi * np.arange(count) / count
    angle = t - strength * np.sin(2 * t + 0.3) - 0.2 * strength * np.sin(t)
    return Domain(np.c_[np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("count", [8, 10, 12, 14, 24])
def test_every_set_of_corners_is_listed_once(count):
    def corners(i0, m):
        n = count // 2 - m
        return tuple(sorted((i0 + np.array([0, m, m + n, 2 * m + n])) % count))

    listed = [corners(i0, m) for i0, m in zip(*corner_pairs(count, count), strict=True)]
    every = {corners(i0, m) for i0 in range(count) for m in range(1, count // 2)}
    assert len(set(listed)) == len(listed)
    assert set(listed) == every


def test_the_squarest_core_is_always_among_fewer_counts():
    _, m = corner_pairs(120, 7)
    assert len(np.unique(m)) == 7
    assert m.max() == 30


def test_the_best_choices_of_each_count_are_kept_in_order():
    m, score = np.array([2, 1, 2, 1, 2]), np.array([0.3, 0.5, 0.1, 0.2, 0.2])
    assert best_per_count(m, score, 2).tolist() == [3, 1, 2, 4]


def test_the_coarse_embedding_reproduces_affine_maps_of_a_symmetric_boundary():
    matrix, _ = reference(4, 2)
    assert matrix.sum(axis=1) == pytest.approx(np.ones(len(matrix)))
    assert (matrix >= 0).all()


def test_a_square_is_cut_at_its_corners():
    t = np.arange(6) / 6
    nodes = np.concatenate([np.c_[t, 0 * t], np.c_[1 + 0 * t, t], np.c_[1 - t, 1 + 0 * t], np.c_[0 * t, 1 - t]])
    i0, m = choices = corner_pairs(24, 24)
    score = rank_corners(nodes, choices, (4, 2), np.full(24, 1 / 6), PlacementOptions())
    assert (i0[score.argmin()], m[score.argmin()]) == (0, 6)


@pytest.mark.parametrize("strength", [0.2, 0.35])
def test_the_search_is_within_a_tenth_of_a_descent_from_every_choice(strength):
    domain = crowded(12, strength)
    local = Domain(domain.frame.to_local(domain.nodes))
    size, options = boundary_size(local), PlacementOptions()

    def energy(i0, m):
        sketch = Sketch.of(local, i0, m, 6, 3)
        return place(sketch, size, None, options, start_of(sketch, size, None, options)).energy

    chosen = RulePolicy().choose(domain)
    best = min(energy(i0, m) for i0, m in zip(*map(np.ndarray.tolist, corner_pairs(12, 12)), strict=True))
    assert energy(chosen.i0, chosen.m) < 1.1 * best


@pytest.mark.parametrize("count", [1, 2, 5, 9, 13, 30])
@pytest.mark.parametrize("limit", [2, 6])
def test_a_subset_reads_the_same_from_both_ends(count, limit):
    kept = subset(count, limit)
    assert kept[0] == 0
    assert kept[-1] == count
    assert (np.diff(kept) > 0).all()
    assert len(kept) <= limit + 1
    assert np.array_equal(kept, count - kept[::-1])


def test_the_wanted_size_on_a_disk_with_even_nodes_is_their_spacing():
    domain = crowded(40, 0.0)
    inside = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2))
    assert boundary_size(domain)(inside) == pytest.approx(np.full(20, domain.spacing[0]))
