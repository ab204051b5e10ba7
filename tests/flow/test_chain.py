"""Chains of stage tasks under a real server: what is cached, what is computed, what a failure looks like."""

import pytest
from prefect import flow
from prefect.settings import PREFECT_API_URL, temporary_settings

from drl_meshgen.errors import overall
from drl_meshgen.store import ArtifactRef, Store
from flows.chain import Detail, Trouble, run_chain
from flows.server import ServerError, answers, connected
from tasks.stage import stage_task
from tests.flow.runs import latest, parents, states
from tests.flow.toys import STAGES, DoubleOptions, NoOptions, NumberOptions, calls

TASKS = {stage.name: stage_task(stage.name, STAGES) for stage in STAGES}


@flow(name="toys")
def toys(names, store, times=1, *, detail=Detail.STAGES, delay=0.0, limit=None):
    outcomes = []
    for name in names:
        options = {"number": NumberOptions(name, delay), "double": DoubleOptions(times), "total": NoOptions()}
        outcomes.append(run_chain(TASKS, name, options, str(store), limit=limit, detail=detail))
    return outcomes


each_detail = pytest.mark.parametrize("detail", Detail, ids=lambda detail: detail.value)


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    return tmp_path / "log"


@each_detail
@pytest.mark.usefixtures("server")
def test_a_warm_run_executes_nothing_and_a_flipped_bit_one_stage(log, tmp_path, detail):
    store = Store(tmp_path / "store")
    (cold,) = toys(["three"], store.root, detail=detail)
    assert calls(log) == ["number", "double", "total"]
    assert cold.failure == ""
    (warm,) = toys(["three"], store.root, detail=detail)
    assert calls(log) == ["number", "double", "total"]
    assert warm == cold
    path = store.objects.path(cold.refs["double"].outputs["value.json"])
    path.chmod(0o644)
    path.write_bytes(b"7" + path.read_bytes()[1:])
    (healed,) = toys(["three"], store.root, detail=detail)
    assert calls(log) == ["number", "double", "total", "double"]
    assert healed == cold


def test_the_dashboard_tells_cached_from_computed(server, tmp_path, wait_for):
    toys(["three"], tmp_path)
    wait_for(lambda: states(server), dict.fromkeys(["number three", "double three", "total three"], "Completed"))
    toys(["three"], tmp_path, times=2)
    expected = {"number three": "Cached", "double three": "Completed", "total three": "Completed"}
    wait_for(lambda: states(server), expected)


def test_without_task_runs_of_stages_the_dashboard_has_none_and_artifacts_are_the_same(server, tmp_path, wait_for):
    (plain,) = toys(["three"], tmp_path / "one", detail=Detail.MODELS)
    assert latest(server) == []
    (shown,) = toys(["three"], tmp_path / "two")
    wait_for(lambda: len(latest(server)), 3)
    assert plain == shown


@each_detail
@pytest.mark.usefixtures("server")
def test_a_chain_ends_when_its_time_is_over(tmp_path, detail):
    (outcome,) = toys(["three"], tmp_path, detail=detail, delay=20.0, limit=0.5)
    assert outcome.failure == "three: stage number was not done when 0.5 seconds were over"
    assert outcome.trouble is Trouble.TOO_LONG
    (outcome,) = toys(["three"], tmp_path, detail=detail, limit=100.0)
    assert outcome.failure == ""


def test_the_graph_ties_each_task_to_the_tasks_it_reads_and_to_no_other_surface(server, tmp_path, wait_for):
    toys(["three", "four"], tmp_path)
    expected = {f"number {n}": set() for n in ("three", "four")}
    expected |= {f"double {n}": {f"number {n}"} for n in ("three", "four")}
    expected |= {f"total {n}": {f"number {n}", f"double {n}"} for n in ("three", "four")}
    wait_for(lambda: parents(server), expected)


@each_detail
@pytest.mark.usefixtures("server")
def test_a_failure_of_the_machine_is_retried(tmp_path, monkeypatch, detail):
    errors = [OSError("no space left")]

    def log(_line):
        if errors:
            raise errors.pop()

    monkeypatch.setattr("tests.flow.toys.log", log)
    (outcome,) = toys(["three"], tmp_path, detail=detail)
    assert outcome.failure == ""
    errors[:] = [OSError("no space left")] * 3
    (outcome,) = toys(["four"], tmp_path, detail=detail)
    assert outcome.failure == "four: stage number: no space left"
    assert outcome.exit_code == 1


@each_detail
@pytest.mark.usefixtures("server")
def test_a_failed_surface_gives_a_sentence_and_the_others_go_on(log, tmp_path, caplog, detail):
    nine, huge, three = toys(["nine", "huge", "three"], tmp_path / "store", detail=detail)
    assert (nine.failure, nine.exit_code) == ("nine: no such number; take three or four", 3)
    assert huge.failure == "huge: double: the number is too big to double (1e+07)"
    assert list(huge.refs) == ["number"]
    assert three.failure == ""
    assert calls(log) == ["number", "number", "double", "number", "double", "total"]
    assert "Traceback" not in caplog.text


@each_detail
@pytest.mark.usefixtures("server")
def test_a_bug_leaves_its_traceback_in_the_log(tmp_path, monkeypatch, caplog, detail):
    monkeypatch.setattr("tests.flow.toys.log", lambda _line: 1 / 0)
    (outcome,) = toys(["three"], tmp_path, detail=detail)
    assert outcome.exit_code == 1
    assert outcome.failure == "three: internal error in stage number: ZeroDivisionError: division by zero"
    assert "Traceback" in caplog.text


def test_a_task_needs_no_server(tmp_path):
    ref = ArtifactRef.from_json(TASKS["number"].fn("three", {}, NumberOptions(), str(tmp_path)))
    assert Store(tmp_path).find("number", ref.key) == ref


def test_exit_codes_are_those_of_the_command_line():
    assert [overall([code]) for code in (0, 4, 3)] == [0, 4, 3]
    assert [overall(two) for two in ([0, 0], [0, 4], [0, 3], [3, 3])] == [0, 4, 5, 5]


def test_a_missing_server_elsewhere_is_an_error_not_a_reason_to_start_one():
    assert not answers("http://127.0.0.1:9/api")
    with (
        temporary_settings({PREFECT_API_URL: "http://server.invalid/api"}),
        pytest.raises(ServerError, match=r"http://server\.invalid/api does not answer"),
        connected(),
    ):
        pass
