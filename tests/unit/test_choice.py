"""The choice between layouts: each is taken to the end, the one with the best quads stays."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen import choice
from drl_meshgen.choice import choose
from drl_meshgen.decompose import DecomposeOptions, decompose
from drl_meshgen.decompose.counts import CountOutcome
from drl_meshgen.decompose.names import name_parts
from drl_meshgen.errors import StageError
from tests.chains import chain

RUN = chain("plate with holes")
PARTITION, SIZES = RUN["partition"], RUN["sizing"]
OPTIONS = DecomposeOptions(target_quads=400, candidates=3)


def shape(layout):
    """What tells layouts of one partition apart."""
    return [(len(junction.strips), junction.lengths.tolist()) for junction in layout.pieces.junctions]


@pytest.fixture
def shortfalls(monkeypatch):
    """Shortfall of every layout that is tried, with its shape; none is as good as needed."""
    seen = []
    trial = choice._trial

    def watched(partition, field, layout, way, search):
        found = trial(partition, field, layout, way, search)
        seen.append((shape(layout), found.shortfall))
        return found

    monkeypatch.setattr(choice, "_trial", watched)
    monkeypatch.setattr(choice, "ENOUGH", -1.0)
    return seen


def test_the_layout_with_the_least_shortfall_stays(shortfalls):
    chosen = choose(PARTITION, SIZES, OPTIONS)
    assert len(shortfalls) == 3
    assert min(shortfalls, key=lambda trial: trial[1])[0] == shape(chosen)


def test_one_candidate_is_not_tried_but_taken(shortfalls):
    chosen = choose(PARTITION, SIZES, DecomposeOptions(target_quads=400, candidates=1))
    assert shape(chosen) == shape(decompose(PARTITION, DecomposeOptions(target_quads=400)))
    assert not shortfalls


def test_the_first_layout_that_is_as_good_as_needed_ends_the_trials(monkeypatch, shortfalls):
    monkeypatch.setattr(choice, "ENOUGH", 1e9)
    assert shape(choose(PARTITION, SIZES, OPTIONS)) == shape(decompose(PARTITION, OPTIONS))
    assert len(shortfalls) == 1


def test_what_is_as_good_as_needed_stays_even_where_another_layout_has_less_shortfall(monkeypatch):
    results = iter([(1.0, False), (2.0, True)])
    tried = []

    def trial(_partition, _field, layout, way, _search):
        tried.append(layout)
        shortfall, is_enough = next(results)
        return choice._Trial(way, np.zeros(len(way.chosen)), shortfall, 0, is_enough)

    monkeypatch.setattr(choice, "_trial", trial)
    assert shape(choose(PARTITION, SIZES, OPTIONS)) == shape(tried[1])


def test_a_way_to_open_a_junction_without_counts_is_passed_over(monkeypatch, shortfalls):
    first = shape(decompose(PARTITION, OPTIONS))
    counted = choice.with_counts

    def failing(partition, parts, options, field):
        layout = counted(partition, parts, options, field)
        if shape(layout) == first:
            raise StageError("decompose", CountOutcome.INFEASIBLE)
        return layout

    monkeypatch.setattr(choice, "with_counts", failing)
    chosen = choose(PARTITION, SIZES, OPTIONS)
    assert len(shortfalls) == 2
    assert min(shortfalls, key=lambda trial: trial[1])[0] == shape(chosen) != first


def test_each_junction_gets_the_candidate_that_did_best_around_it(monkeypatch):
    run = chain("four limbs")
    tried = []

    def trial(_partition, _field, layout, way, _search):
        tried.append(layout)
        costs = np.array([(j + len(tried)) % 2 for j in range(len(way.chosen))], float)
        return choice._Trial(way, costs, float(-len(tried)), 0, is_enough=False)

    monkeypatch.setattr(choice, "_trial", trial)
    options = DecomposeOptions(target_quads=700, candidates=2)
    chosen = choose(run["partition"], run["sizing"], options)
    for j in range(len(chosen.pieces.junctions)):
        assert shape(chosen)[j] == shape(tried[(j + 1) % 2])[j]


@pytest.mark.parametrize(("folded", "stays"), [(4, False), (3, False), (2, True)])
def test_what_stays_folded_is_tried_with_the_turning_of_its_charts_which_stays_if_clearly_less_is_folded(
    monkeypatch, folded, stays
):
    tried = []

    def trial(_partition, _field, layout, way, _search):
        tried.append(layout)
        bad = 4 if layout.turning else folded
        return choice._Trial(way, np.zeros(len(way.chosen)), 1000.0 * bad + len(tried), bad, is_enough=False)

    monkeypatch.setattr(choice, "_trial", trial)
    chosen = choose(PARTITION, SIZES, OPTIONS)
    assert [layout.turning is None for layout in tried] == [False, False, False, True]
    assert (chosen.turning is None) == stays
    assert shape(chosen) == shape(tried[-1]) == shape(tried[0])


def test_without_turning_nothing_is_tried_twice(monkeypatch):
    tried = []

    def trial(_partition, _field, _layout, way, _search):
        tried.append(way)
        return choice._Trial(way, np.zeros(len(way.chosen)), 4000.0, 4, is_enough=False)

    monkeypatch.setattr(choice, "_trial", trial)
    choose(PARTITION, SIZES, replace(OPTIONS, block_weight=0.0))
    assert len(set(tried)) == len(tried) == 3


def test_counts_that_people_fix_do_not_change_the_choice(shortfalls):
    free = choose(PARTITION, SIZES, OPTIONS)
    edges = name_parts(PARTITION, free.pieces).edges
    wanted = int(free.curve_counts[-1]) + 2
    fixed = choose(PARTITION, SIZES, replace(OPTIONS, fixed=((edges[-1], wanted),)))
    assert shape(fixed) == shape(free)
    assert fixed.curve_counts[-1] == wanted
    assert shortfalls[: len(shortfalls) // 2] == shortfalls[len(shortfalls) // 2 :]
