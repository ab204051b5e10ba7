"""Chains of stages in this process, in memory and through a store."""

from dataclasses import replace
from functools import wraps

import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.store import Store, ancestors, execute, reopen
from drl_meshgen.store.canonical import file_digest
from tests.flow.toys import DOUBLE, NUMBER, STAGES, TOTAL, DoubleOptions, NumberOptions, calls


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    return tmp_path / "log"


def test_a_chain_in_memory_hands_results_on(log):
    run = execute(STAGES)
    assert [run[stage.name] for stage in STAGES] == [3, 6, 9]
    assert calls(log) == ["number", "double", "total"]
    assert not run.refs


def test_a_chain_through_a_store_gives_the_same_results(tmp_path):
    assert execute(STAGES, store=Store(tmp_path))["total"] == execute(STAGES)["total"]


def test_a_warm_rerun_executes_no_stage_and_still_gives_the_results(log, tmp_path):
    store = Store(tmp_path / "store")
    cold, before = execute(STAGES, store=store), calls(log)
    warm = execute(STAGES, store=store)
    assert calls(log) == before
    assert warm.refs == cold.refs
    assert warm["total"] == cold["total"]
    assert [timing.cached for timing in cold.timings] == [False] * 3
    assert [timing.cached for timing in warm.timings] == [True] * 3
    assert [timing.computed for timing in warm.timings] == [timing.computed for timing in cold.timings]


def test_a_changed_option_computes_only_what_follows(log, tmp_path):
    store = Store(tmp_path / "store")
    execute(STAGES, store=store)
    log.unlink()
    assert execute(STAGES, {"double": DoubleOptions(times=2)}, store=store)["total"] == 15
    assert calls(log) == ["double", "total"]


def test_an_option_outside_the_identity_changes_nothing(log, tmp_path):
    store = Store(tmp_path / "store")
    execute(STAGES, store=store)
    log.unlink()
    execute(STAGES, {"number": NumberOptions(delay=0.01)}, store=store)
    assert calls(log) == []


def test_a_flipped_bit_computes_one_stage(log, tmp_path):
    store = Store(tmp_path / "store")
    cold = execute(STAGES, store=store)
    path = store.objects.path(cold.refs["double"].outputs["value.json"])
    path.chmod(0o644)
    path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:])
    log.unlink()
    assert execute(STAGES, store=store)["total"] == 9
    assert calls(log) == ["double"]


def test_only_what_the_targets_need_is_run(log):
    run = execute(STAGES, targets=["double"])
    assert calls(log) == ["number", "double"]
    with pytest.raises(KeyError, match="total"):
        run["total"]


def test_progress_is_told_before_and_after_each_stage():
    told = []
    execute(STAGES, progress=told.append)
    assert [(p.stage, p.index, p.total, p.timing is None) for p in told] == [
        ("number", 0, 3, True),
        ("number", 0, 3, False),
        ("double", 1, 3, True),
        ("double", 1, 3, False),
        ("total", 2, 3, True),
        ("total", 2, 3, False),
    ]


def test_errors_of_a_stage_pass_through_and_are_not_stored(log, tmp_path):
    for _ in range(2):
        with pytest.raises(InputError, match="five: no such number"):
            execute(STAGES, {"number": NumberOptions("five")}, store=Store(tmp_path / "store"))
    assert calls(log) == ["number", "number"]


def test_options_for_an_unknown_stage_are_refused():
    with pytest.raises(ValueError, match="options for ricci"):
        execute(STAGES, {"ricci": NumberOptions()})


def test_a_chain_out_of_order_is_refused():
    with pytest.raises(ValueError, match="double needs number"):
        ancestors([DOUBLE, NUMBER])


def test_a_stage_listed_twice_is_refused():
    with pytest.raises(ValueError, match="listed twice"):
        ancestors([NUMBER, NUMBER])


def test_an_unknown_target_is_refused():
    with pytest.raises(ValueError, match="no stage is called lift"):
        ancestors([NUMBER, DOUBLE, TOTAL], ["lift"])


def test_the_text_of_a_stage_s_own_functions_belongs_to_its_source():
    def other(inputs, _options):
        return inputs["number"] * 3

    @wraps(DOUBLE.run)
    def timed(inputs, options):
        return DOUBLE.run(inputs, options)

    assert replace(DOUBLE, run=other).source != DOUBLE.source
    assert replace(DOUBLE, run=timed).source == DOUBLE.source


def test_an_unreadable_file_in_the_identity_is_bad_input(tmp_path):
    stage = replace(NUMBER, identity=lambda _options: file_digest(tmp_path / "none.stl"))
    with pytest.raises(InputError, match=r"none\.stl: no such file or directory"):
        execute([stage], store=Store(tmp_path))


def test_a_run_is_opened_again_from_its_references(log, tmp_path):
    store = Store(tmp_path / "store")
    cold = execute(STAGES, store=store)
    log.unlink()
    again = reopen(STAGES, cold.refs, store)
    assert again["total"] == cold["total"]
    assert [t.computed for t in again.timings] == [t.computed for t in cold.timings]
    assert calls(log) == []
