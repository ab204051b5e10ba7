"""The join tree on functions whose tips, saddles and persistence are known, with ties and plateaus."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drl_meshgen.partition.join_tree import Large, join_tree
from tests.chains import grid

FEW = settings(max_examples=40, deadline=None, derandomize=True)
SHEET = grid(7, 6).topology
depths = st.lists(st.integers(0, 12), min_size=56, max_size=56).map(lambda x: np.array(x, float))


def path(values):
    n = len(values)
    return np.c_[np.arange(n - 1), np.arange(1, n)], np.array(values, float)


def superlevel_components(edges, depth, level):
    above = depth > level
    inside = edges[above[edges].all(axis=1)]
    graph = coo_matrix((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (len(depth),) * 2)
    return len(np.unique(connected_components(graph, directed=False)[1][above]))


def persistence_pairs(tree):
    """Value and persistence of every merge that is not of zero persistence."""
    pairs = tree.merges[tree.merges.persistence > 0]
    return Counter(zip(pairs.value, pairs.persistence, strict=True))


def test_tips_saddles_and_persistence_of_three_peaks():
    #        5
    #   3   / \  4
    #  / \1/   \2/\
    # 0            0
    tree = join_tree(*path([0, 3, 1, 5, 2, 4, 0]), persistence=0.5, min_arc=0.1)
    assert tree.tips == (1, 3, 5)
    merges = tree.merges[["saddle", "value", "dies", "survives", "persistence"]]
    assert merges.to_numpy().tolist() == [[4, 2, 5, 3, 2], [2, 1, 1, 3, 2]]


def test_arcs_of_three_peaks_form_a_tree():
    tree = join_tree(*path([0, 3, 1, 5, 2, 4, 0]), persistence=0.5, min_arc=0.1)
    arcs = {(tuple(sorted(a.tips)), a.low, a.high) for a in tree.arcs}
    assert arcs == {((3,), 2, 5), ((5,), 2, 4), ((3, 5), 1, 2), ((1,), 1, 3), ((1, 3, 5), 0, 1)}
    by_tips = {tuple(sorted(a.tips)): a for a in tree.arcs}
    assert by_tips[3,].lower == by_tips[5,].lower == by_tips[3, 5].upper
    assert by_tips[3, 5].lower == by_tips[1,].lower == by_tips[1, 3, 5].upper
    assert by_tips[1, 3, 5].lower == -1


def test_a_peak_of_little_persistence_is_absorbed_by_its_neighbour():
    tree = join_tree(*path([0, 5, 2, 2.5, 1, 6, 0]), persistence=1.0, min_arc=0.1)
    assert tree.tips == (1, 5)
    assert tree.basin[3] == 1
    assert set(tree.basin.tolist()) == {1, 5}


@pytest.mark.parametrize(("least", "tips"), [(3.0, (2, 7)), (3.1, (7,))])
def test_a_peak_of_little_persistence_stays_where_both_sides_of_its_saddle_have_enough_area(least, tips):
    # three vertices lie above the saddle on one side, four on the other
    edges, depth = path([0, 2.1, 2.5, 2.2, 2, 2.3, 2.4, 6, 2.2, 0])
    large = Large(np.ones(10), least, 0.4)
    assert join_tree(edges, depth, 1.0, 0.1, large).tips == tips
    assert join_tree(edges, depth, 1.0, 0.1).tips == (7,)
    assert join_tree(edges, depth, 1.0, 0.1, Large(np.ones(10), least, 0.6)).tips == (7,)


@FEW
@given(depths, st.floats(0.5, 6), st.floats(0.1, 1.0), st.floats(0, 9))
def test_large_limbs_are_kept_between_those_of_the_two_persistences(depth, persistence, share, least):
    few = join_tree(SHEET.edges, depth, persistence, 1.0)
    many = join_tree(SHEET.edges, depth, share * persistence, 1.0)
    some = join_tree(SHEET.edges, depth, persistence, 1.0, Large(np.ones(56), least, share * persistence))
    assert set(few.tips) <= set(some.tips) <= set(many.tips)
    if least == 0:
        assert some.tips == many.tips


def test_saddles_closer_than_the_shortest_arc_are_one_junction():
    heights = [0, 9, 3.0, 9.5, 2.6, 8, 0]
    apart = join_tree(*path(heights), persistence=1.0, min_arc=0.1)
    joined = join_tree(*path(heights), persistence=1.0, min_arc=1.0)
    assert [len(a.tips) for a in apart.arcs] == [1, 1, 2, 1, 3]
    assert [len(a.tips) for a in joined.arcs] == [1, 1, 1, 3]
    assert len({a.lower for a in joined.arcs if a.lower >= 0}) == 1


def test_a_chain_of_close_saddles_is_one_junction_where_neighbours_are_close():
    heights = [0, 9, 3.0, 9.5, 2.6, 8, 2.2, 7, 0]
    arcs = join_tree(*path(heights), persistence=1.0, min_arc=0.5).arcs
    assert sorted(len(a.tips) for a in arcs) == [1, 1, 1, 1, 4]
    assert len({a.lower for a in arcs if a.lower >= 0}) == 1


def test_clusters_of_saddles_that_meet_become_one_junction():
    # two pairs, each with its own saddle (5, 5.2), merge at 4.9
    heights = [0, 9, 5, 8, 4.9, 8.5, 5.2, 9.5, 0]
    arcs = join_tree(*path(heights), persistence=1.0, min_arc=1.0).arcs
    assert sorted(len(a.tips) for a in arcs) == [1, 1, 1, 1, 4]
    below = {a.lower for a in arcs if a.lower >= 0}
    assert len(below) == 1
    assert next(a.upper for a in arcs if a.lower < 0) in below


def test_a_plateau_is_one_tip_and_its_saddle_costs_nothing():
    tree = join_tree(*path([0, 2, 2, 2, 1, 3, 0]), persistence=0.5, min_arc=0.1)
    assert len(tree.tips) == 2
    assert persistence_pairs(tree) == {(1, 1): 1}


def test_a_constant_function_has_one_tip_and_one_arc():
    tree = join_tree(SHEET.edges, np.zeros(56), persistence=0.5, min_arc=0.1)
    assert len(tree.tips) == len(tree.arcs) == 1
    assert tree.merges.empty


@FEW
@given(depths)
def test_components_of_every_superlevel_set_are_births_less_merges(depth):
    tree = join_tree(SHEET.edges, depth, persistence=0.0, min_arc=1e-9)
    top = np.lexsort((np.arange(56), depth))[-1]
    births = depth[[top, *tree.merges.dies]]
    for level in np.arange(-0.5, 12):
        expected = (births > level).sum() - (tree.merges.value > level).sum()
        assert superlevel_components(SHEET.edges, depth, level) == expected


@FEW
@given(depths, st.floats(0.5, 6), st.floats(0.1, 4))
def test_arcs_are_a_tree_of_tips_and_junctions(depth, persistence, min_arc):
    tree = join_tree(SHEET.edges, depth + 1, persistence, min_arc)
    into = Counter(arc.lower for arc in tree.arcs)
    out_of = Counter(arc.upper for arc in tree.arcs if arc.upper >= 0)
    assert into.pop(-1) == 1
    assert into.keys() == out_of.keys()
    assert min(into.values(), default=2) >= 2
    assert set(out_of.values()) <= {1}
    assert len(tree.arcs) == len(tree.tips) + len(into)
    root = next(arc for arc in tree.arcs if arc.lower == -1)
    assert tuple(sorted(root.tips)) == tree.tips
    for arc in tree.arcs:
        if arc.lower >= 0:
            assert arc.high - arc.low >= (persistence if arc.upper < 0 else min_arc)


@FEW
@given(depths, st.floats(0.0, 6))
def test_tips_are_top_and_every_death_of_enough_persistence(depth, persistence):
    tree = join_tree(SHEET.edges, depth, persistence, 1.0)
    assert len(tree.tips) == 1 + (tree.merges.persistence >= persistence).sum()
    assert depth[list(tree.tips)].max() == depth.max()
    assert set(tree.basin.tolist()) == set(tree.tips)


@FEW
@given(depths, st.randoms(use_true_random=False))
def test_pairs_of_value_and_persistence_do_not_depend_on_the_order_of_vertices(depth, random):
    new = np.array(random.sample(range(56), 56))
    moved = np.empty(56)
    moved[new] = depth
    one = join_tree(SHEET.edges, depth, 1.0, 1.0)
    two = join_tree(np.sort(new[SHEET.edges], axis=1), moved, 1.0, 1.0)
    assert persistence_pairs(one) == persistence_pairs(two)


def test_tips_arcs_and_basins_follow_the_vertices_where_no_depths_are_equal():
    rng = np.random.default_rng(3)
    depth = 12 * rng.random(56)
    new = rng.permutation(56)
    moved = np.empty(56)
    moved[new] = depth
    one, two = (join_tree(e, d, 1.5, 1.0) for e, d in ((SHEET.edges, depth), (np.sort(new[SHEET.edges], 1), moved)))
    assert len(one.tips) > 2
    assert sorted(new[list(one.tips)]) == list(two.tips)
    np.testing.assert_array_equal(two.basin[new], new[one.basin])
    describe = lambda tree, to: {(tuple(sorted(to[list(a.tips)])), a.low, a.high) for a in tree.arcs}  # noqa: E731
    assert describe(one, new) == describe(two, np.arange(56))


@pytest.mark.parametrize("factor", [1e-3, 7.0])
def test_the_tree_scales_with_its_function(factor):
    depth = 12 * np.random.default_rng(4).random(56)
    one = join_tree(SHEET.edges, depth, 1.5, 1.0)
    two = join_tree(SHEET.edges, factor * depth, 1.5 * factor, factor)
    assert one.tips == two.tips
    np.testing.assert_allclose([a.low * factor for a in one.arcs], [a.low for a in two.arcs], rtol=1e-12)
