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
    """Shortfall of every layout that is tried, with its shape; none is fine at once."""
    seen = []
    trial = choice._trial

    def watched(partition, field, layout, chosen):
        found = trial(partition, field, layout, chosen)
        seen.append((shape(layout), found.shortfall))
        return found

    monkeypatch.setattr(choice, "_trial", watched)
    monkeypatch.setattr(choice._Outcome, "is_fine", False)
    return seen


def test_the_layout_with_the_least_shortfall_stays(shortfalls):
    chosen = choose(PARTITION, SIZES, OPTIONS)
    assert len(shortfalls) == 3
    assert min(shortfalls, key=lambda trial: trial[1])[0] == shape(chosen)


def test_one_candidate_is_not_tried_but_taken(shortfalls):
    chosen = choose(PARTITION, SIZES, DecomposeOptions(target_quads=400, candidates=1))
    assert shape(chosen) == shape(decompose(PARTITION, DecomposeOptions(target_quads=400)))
    assert not shortfalls


def test_nothing_is_tried_where_the_first_layout_needs_no_repair(monkeypatch):
    monkeypatch.delattr(choice, "_trial")
    monkeypatch.setattr(choice._Outcome, "is_fine", True)
    assert shape(choose(PARTITION, SIZES, OPTIONS)) == shape(decompose(PARTITION, OPTIONS))


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

    def trial(_partition, _field, layout, chosen):
        tried.append(layout)
        costs = np.array([(j + len(tried)) % 2 for j in range(len(chosen))], float)
        return choice._Trial(chosen, costs, float(-len(tried)))

    monkeypatch.setattr(choice, "_trial", trial)
    monkeypatch.setattr(choice._Outcome, "is_fine", False)
    options = DecomposeOptions(target_quads=700, candidates=2)
    chosen = choose(run["partition"], run["sizing"], options)
    for j in range(len(chosen.pieces.junctions)):
        assert shape(chosen)[j] == shape(tried[(j + 1) % 2])[j]


def test_counts_that_people_fix_do_not_change_the_choice(shortfalls):
    free = choose(PARTITION, SIZES, OPTIONS)
    edges = name_parts(PARTITION, free.pieces).edges
    wanted = int(free.curve_counts[-1]) + 2
    fixed = choose(PARTITION, SIZES, replace(OPTIONS, fixed=((edges[-1], wanted),)))
    assert shape(fixed) == shape(free)
    assert fixed.curve_counts[-1] == wanted
    assert shortfalls[: len(shortfalls) // 2] == shortfalls[len(shortfalls) // 2 :]
