"""Progress of long work as the dashboard has it."""

import httpx
import pytest
from prefect import flow, task
from prefect.client.orchestration import get_client
from prefect.settings import PREFECT_API_URL, temporary_settings

import tasks.progress
from drl_meshgen.progress import counter
from tasks.progress import counted, shown


@task
def work(steps):
    with shown("toy three"):
        step = counter("toys made", steps)
        for _ in range(steps):
            step()
    return steps


@flow(name="toy progress")
def toys(steps, count=1):
    with counted("toys", "boxes done", count) as advance:
        for _ in range(count):
            work(steps)
            advance()


def artifacts(api):
    with temporary_settings({PREFECT_API_URL: api}), get_client(sync_client=True) as client:
        newest = max(client.read_flow_runs(), key=lambda run: run.created)
        found = client.read_artifacts()
    return sorted((a.key, a.data, a.description) for a in found if a.flow_run_id == newest.id)


def test_long_work_leaves_a_bar_that_ends_full(server, monkeypatch):
    monkeypatch.setattr(tasks.progress, "EVERY", 0.0)
    monkeypatch.setattr(tasks.progress.Shown.__init__, "__kwdefaults__", {"after": 0.0})
    toys(3, 2)
    bars = artifacts(server)
    assert ("progress-toys", 100.0, "boxes done: 2 of 2") in bars
    assert [bar for bar in bars if bar[0] == "progress-toy-three"] == [
        ("progress-toy-three", 100.0, "toys made: 3 of 3")
    ] * 2


def test_short_work_leaves_none(server):
    toys(3)
    assert artifacts(server) == []


@pytest.mark.parametrize(("whole", "text"), [(True, "steps: 9 of 9"), (False, "steps: 4 of 9, reward 1")])
def test_work_that_may_end_early_ends_with_a_bar_that_says_so(monkeypatch, whole, text):
    sent = []
    monkeypatch.setattr(tasks.progress, "create_progress_artifact", lambda *_a, **k: sent.append(k) or "id")
    monkeypatch.setattr(tasks.progress, "update_progress_artifact", lambda *_a, **k: sent.append(k))
    listener = tasks.progress.Shown("toy", after=0.0)
    listener(tasks.progress.Advance("steps", 3, 9))
    listener(tasks.progress.Advance("steps", 4, 9, "reward 1"))
    listener.finish(whole=whole)
    assert sent[-1]["description"].startswith(text)


def test_updates_are_seldom(monkeypatch):
    sent = []
    monkeypatch.setattr(tasks.progress, "create_progress_artifact", lambda *a, **_k: sent.append(a) or "id")
    monkeypatch.setattr(tasks.progress, "update_progress_artifact", lambda *a, **_k: sent.append(a))
    listener = tasks.progress.Shown("toy", after=0.0)
    for k in range(1000):
        listener(tasks.progress.Advance("steps", k, 1000))
    listener.finish()
    assert len(sent) == 2


@pytest.mark.usefixtures("server")
def test_a_dashboard_that_cannot_be_reached_does_not_stop_the_work(monkeypatch, caplog):
    def refuse(*_arguments, **_options):
        raise httpx.ConnectError("refused")

    monkeypatch.setattr(tasks.progress, "create_progress_artifact", refuse)
    monkeypatch.setattr(tasks.progress.Shown.__init__, "__kwdefaults__", {"after": 0.0})
    toys(3)
    assert "progress is not shown: refused" in caplog.text


def test_work_outside_of_a_run_shows_nothing_and_ends():
    assert work.fn(3) == 3
