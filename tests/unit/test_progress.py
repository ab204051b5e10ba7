"""Long work tells how far it has come, to whoever listens, and to nobody else."""

import numpy as np
import pytest

from drl_meshgen.pipeline import STAGES, MeshOptions
from drl_meshgen.progress import Advance, counter, listening
from drl_meshgen.store import execute


@pytest.fixture(scope="module")
def hemisphere():
    options = MeshOptions().sized(200).by_stage("hemisphere", 5000)
    told = []
    with listening(told.append):
        done = execute(STAGES, options)
    return options, done, told


def test_who_listens_is_told_the_total_first_and_then_every_step():
    told = []
    with listening(told.append):
        step = counter("things done", 2)
        step()
        step()
    assert told == [Advance("things done", k, 2) for k in range(3)]


def test_nobody_is_told_after_the_listener_has_left_or_within_silent_work():
    told = []
    with listening(told.append), listening(None):
        counter("inner things", 5)()
    counter("later things", 5)()
    assert told == []


def test_long_stages_tell_and_never_more_than_all(hemisphere):
    told = hemisphere[2]
    assert {one.what for one in told} == {
        "layouts tried",
        "pieces meshed",
        "phases of the node optimiser done",
    }
    assert all(0 <= one.done <= one.total for one in told)
    pieces = [one for one in told if one.what == "pieces meshed"]
    assert [one.done for one in pieces] == list(range(pieces[-1].total + 1))


def test_results_are_the_same_bits_with_and_without_a_listener(hemisphere):
    options, done, _ = hemisphere
    again = execute(STAGES, options)
    assert np.array_equal(again["smoothing"].mesh.points, done["smoothing"].mesh.points)
