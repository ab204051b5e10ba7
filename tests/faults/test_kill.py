"""SIGKILL at every point of every stage: the next run ends, serves nothing half done, and gives what it ever gave."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from drl_meshgen.pipeline import COMPARED_STAGES
from drl_meshgen.store import Store, execute
from drl_meshgen.store.verify import verify
from tests.faults.victim import OPTIONS, POINTS

STAGES = tuple(stage.name for stage in COMPARED_STAGES)
PATIENCE = 120.0
"""Seconds after which a run counts as hanging."""


class Victim:
    """The process of `victim.py`."""

    def __init__(self):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.victim"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
            text=True,
        )

    def run(self, store, stage, point=None, count=1):
        """Return how the children ended, and which stages they computed."""
        log = store.root.parent / "log"
        log.write_text("")
        told = {"store": str(store.root), "stage": stage, "point": point, "count": count, "log": str(log)}
        watch = threading.Timer(PATIENCE, os.killpg, (self.process.pid, 9))
        watch.start()
        self.process.stdin.write(json.dumps(told) + "\n")
        self.process.stdin.flush()
        ended = self.process.stdout.readline()
        watch.cancel()
        assert ended, f"hung or ended: {told}"
        return json.loads(ended), log.read_text().split()


@pytest.fixture(scope="module")
def victim():
    one = Victim()
    yield one
    one.process.communicate(timeout=30)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return the artifacts of a run that nobody disturbed."""
    options = OPTIONS.by_stage("hemisphere", 5000, compare=True)
    return execute(COMPARED_STAGES, options, store=Store(tmp_path_factory.mktemp("undisturbed"))).refs


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Return one store for all points, so that each case finds what came before it done."""
    root = tmp_path_factory.mktemp("killed") / "store"
    (root / "records").mkdir(parents=True)
    return Store(root)


def same(one, other):
    """Tell whether two artifacts are the same, but for what Gmsh makes: other bytes in each process."""
    return one.key == other.key and (one == other or one.stage == "comparison")


@pytest.mark.parametrize("stage", STAGES)
def test_a_killed_stage_leaves_nothing_half_done_and_the_next_run_ends_as_ever(victim, undisturbed, store, stage):
    ref = undisturbed[stage]
    for point in POINTS:
        ended, computed = victim.run(store, stage, point)
        assert ended == [-9], f"{stage} was not killed at {point}"
        assert computed == [stage], f"{stage} killed at {point}: earlier stages were computed again"
        assert verify(store).damages == (), f"{stage} killed at {point}"
        kept = store.find(stage, ref.key)
        assert (kept is not None) == (point == "recorded"), f"{stage} killed at {point}"
        assert kept is None or same(kept, ref)
        if point == "recorded":
            store.record_path(stage, ref.key).unlink()
    ended, computed = victim.run(store, stage)
    assert (ended, computed) == ([0], [stage])
    assert same(store.find(stage, ref.key), ref)


def test_four_processes_on_one_chain_compute_each_stage_once(victim, undisturbed, tmp_path):
    store = Store(tmp_path / "store")
    ended, computed = victim.run(store, "quality", count=4)
    assert ended == [0, 0, 0, 0]
    assert sorted(computed) == sorted(STAGES[:-1])
    assert all(store.find(stage, undisturbed[stage].key) == undisturbed[stage] for stage in STAGES[:-1])


def test_who_waits_for_a_process_that_is_killed_computes_in_its_place(victim, undisturbed, tmp_path):
    store = Store(tmp_path / "store")
    ended, computed = victim.run(store, "model", "unrecorded", count=3)
    assert ended == [-9, -9, -9]
    assert computed == ["model", "model", "model"]
    assert victim.run(store, "model") == ([0], ["model"])
    assert store.find("model", undisturbed["model"].key) == undisturbed["model"]
