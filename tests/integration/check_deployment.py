"""The topology of compose.yaml, run with real processes, looked at with a browser, and disturbed.

Not collected by `make test`; `make integration` runs it. Needs Postgres, Chromium, Node.js and playwright-core. The
checks build on each other: pytest runs them in this order and stops at the first that fails (-x).
"""

import json
import os
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml

from drl_meshgen.export import read_table
from drl_meshgen.export.vtk_files import write_surface_ply
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import load
from drl_meshgen.store import Store
from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.verify import verify
from tests.integration.api import Api, until
from tests.integration.topology import ROOT, Topology

PICTURES = ROOT / "reports/generated/integration"
SMALL = {"target_quads": 300, "compare": False}
MODELS = 12
"""Surfaces of the batch that nothing disturbs; others have half of them."""


def domes(folder, first, count):
    """Write hemispheres of several heights, each a surface of its own, and return their paths below `folder`."""
    round_one = load("hemisphere", triangles=5_000)
    names = []
    for k in range(first, first + count):
        names.append(f"models/dome{k:03}.ply")
        write_surface_ply(folder / names[-1], TriMesh(round_one.points * [1, 1, 0.5 + 0.002 * k], round_one.triangles))
    return names


@pytest.fixture(scope="session")
def topology():
    shutil.rmtree(PICTURES, ignore_errors=True)
    PICTURES.mkdir(parents=True)
    made = Topology()
    try:
        shutil.copy(ROOT / "prefect.yaml", made.app)
        given = yaml.safe_load((ROOT / "prefect.yaml").read_text())
        nightly = next(one for one in given["deployments"] if one["name"] == "nightly")
        often = {**nightly, "name": "every-minute", "schedules": [{**nightly["schedules"][0], "cron": "* * * * *"}]}
        often["parameters"] = {**nightly["parameters"], **SMALL, "models": domes(made.app, 900, 1)}
        often["parameters"]["out"] = "reports/generated/often"
        given["deployments"].append(often)
        (made.app / "prefect.yaml").write_text(yaml.safe_dump(given))
        made.start()
        yield made
    finally:
        logs = PICTURES / "logs"
        shutil.copytree(made.folder / "logs", logs, dirs_exist_ok=True)
        made.stop()


@pytest.fixture(scope="session")
def api(topology):
    return Api(f"http://127.0.0.1:{topology.ports['server']}/api")


@pytest.fixture(scope="session")
def store(topology):
    return Store(topology.app / "artifacts")


@pytest.fixture(scope="session")
def files(topology):
    return f"http://127.0.0.1:{topology.ports['files']}"


def finished(store, names):
    """Return which surfaces have a mesh that was measured."""
    catalogue = Catalogue.of(store) if (store.root / "records").is_dir() else Catalogue([])
    there = {name for one in catalogue.records if one.ref.stage == "quality" for name in catalogue.surfaces(one)}
    return {name for name in names if Path(name).name in there}


class Batch:
    """A batch in two shards, which may end before its time and is then asked for again."""

    def __init__(self, api, names, *, pictures=False):
        self.api, self.names = api, names
        self.own = {**SMALL, "pictures": pictures, "shard_size": len(names) // 2}
        self.out = f"reports/generated/{Path(names[0]).stem}"
        self.again = 0
        self.run = self.start()

    def start(self):
        return self.api.start("batch/nightly", models=self.names, out=self.out, **self.own)

    def halfway(self, store):
        """Wait until some surfaces are done and others are not."""
        until(lambda: len(finished(store, self.names)) >= 2, 180, "first surfaces of the batch")
        assert len(finished(store, self.names)) < len(self.names)

    def shards(self):
        """Return the runs of its shards, retried ones included."""
        runs = self.api.runs(parent_task_run_id={"is_null_": False})
        return [run for run in runs if set(run["parameters"].get("names") or []) & {Path(n).stem for n in self.names}]

    def ended(self):
        """Wait for its end, and ask again where something broke it."""
        while (state := self.api.wait(self.run)["state_type"]) != "COMPLETED":
            assert state in {"CRASHED", "FAILED"}
            assert self.again < 2
            self.again += 1
            self.run = self.start()


def complete(topology, batch, store):
    """Tell that every surface of a batch has its row with figures, and that the store is sound."""
    batch.ended()
    table = read_table(topology.app / batch.out / "batch.parquet")
    assert sorted(table["name"]) == [Path(name).stem for name in batch.names]
    assert list(table["exit_code"]) == [0] * len(batch.names)
    assert (table["min_angle"] > 0).all()
    assert finished(store, batch.names) == set(batch.names)
    assert verify(store).damages == ()


def test_twelve_models_finish_over_two_workers_while_a_schedule_fires(topology, api, store):
    batch = Batch(api, domes(topology.app, 0, MODELS), pictures=True)
    until(lambda: [one["status"] for one in api.workers("local")] == ["ONLINE"] * 2, 60, "two workers")
    complete(topology, batch, store)
    assert batch.again == 0
    assert len({run["infrastructure_pid"] for run in batch.shards()}) == 2
    deployment = api.deployment("batch/every-minute")
    fired = {"deployment_id": {"any_": [deployment["id"]]}, "state": {"type": {"any_": ["COMPLETED"]}}}
    run = until(lambda: api.runs(**fired), 150, "a scheduled run")[0]
    assert run["auto_scheduled"]
    assert run["expected_start_time"].endswith(("00Z", "00+00:00", "00.000000Z"))
    api.ask(f"/deployments/{deployment['id']}/pause_deployment", {})
    topology.seen = {"batch": batch.run, "cron": run["id"]}


def look(pages):
    """Open pages in Chromium and return what it saw."""
    place = Path(__file__).with_name("look.cjs")
    result = subprocess.run(
        ["node", place, json.dumps(pages)], capture_output=True, text=True, timeout=300, check=False, env=os.environ
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_a_bad_file_is_a_failed_run_that_says_why(topology, api):
    (topology.app / "models/broken.stl").write_text("solid nothing")
    surfaces = ["models/dome000.ply", "models/broken.stl"]
    run = api.wait(api.start("mesh/mesh", surfaces=surfaces, **SMALL))
    assert run["state_type"] == "FAILED"
    assert "broken.stl" in run["state"]["message"]
    topology.seen["failed"] = run["id"]


def test_pages_show_in_a_browser_what_ran(topology, api, store, files):
    site = f"http://127.0.0.1:{topology.ports['server']}"
    run, failed = topology.seen["batch"], topology.seen["failed"]
    shown = [one for number in (run, failed) for one in api.artifacts(number)]
    page, *_, failure = [one for one in shown if one["type"] == "markdown"]
    table = next(one for one in shown if one["type"] == "table")
    report = next(one.ref for one in Catalogue.of(store).records if one.ref.stage == "report")
    wanted = [
        ("dashboard", f"{site}/dashboard", "Flow Runs", None),
        ("run", f"{site}/runs/flow-run/{run}", "Completed", None),
        ("artifacts", f"{site}/runs/flow-run/{run}", page["key"], "Artifacts"),
        ("page", f"{site}/artifacts/artifact/{page['id']}", "dome000", None),
        ("table", f"{site}/artifacts/artifact/{table['id']}", "dome002", None),
        ("failure", f"{site}/artifacts/artifact/{failure['id']}", "broken", None),
        ("failed", f"{site}/runs/flow-run/{failed}", "broken.stl", None),
        ("workers", f"{site}/work-pools/work-pool/local", "local", None),
        ("deployments", f"{site}/deployments", "every-minute", None),
        ("files", f"{files}/", "Latest runs", None),
        ("report", f"{files}/artifacts/report/{report.key}/index.html", "Comparison", None),
    ]
    pages = [
        {"url": url, "text": text, "click": click, "file": str(PICTURES / f"{name}.png")}
        for name, url, text, click in wanted
    ]
    seen = {name: one for (name, *_), one in zip(wanted, look(pages), strict=True)}
    (PICTURES / "seen.json").write_text(json.dumps(seen, indent=1))
    assert {name: one["errors"] for name, one in seen.items() if not one["found"]} == {}
    assert {name: one["broken"] for name, one in seen.items() if one["broken"]} == {}
    assert {name: one["outside"] for name, one in seen.items() if one["outside"]} == {}
    assert seen["failure"]["pictures"] >= 1
    assert seen["report"]["pictures"] >= 6
    assert [error for error in seen["report"]["errors"] if "Content Security" in error] == []


def test_the_file_server_serves_the_store_and_nothing_else(files):
    for path in ("/../secret", "/home", "/artifacts/../../logs", "/%2e%2e/%2e%2e/etc/passwd"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(files + path, timeout=10)


def test_a_server_killed_in_mid_batch_loses_nothing(topology, api, store):
    batch = Batch(api, domes(topology.app, 100, MODELS // 2))
    batch.halfway(store)
    server = topology.services["server-1"]
    server.kill()
    time.sleep(5)
    server.start()
    server.wait()
    complete(topology, batch, store)


def test_a_database_stopped_in_mid_batch_loses_nothing(topology, api, store):
    batch = Batch(api, domes(topology.app, 200, MODELS // 2))
    batch.halfway(store)
    postgres = topology.services["postgres-1"]
    postgres.stop()
    time.sleep(5)
    postgres.start()
    postgres.wait()
    complete(topology, batch, store)


def test_a_worker_killed_before_its_run_begins_loses_nothing(topology, api, store):
    batch = Batch(api, domes(topology.app, 400, MODELS // 2))

    def starting():
        return [run for run in batch.shards() if run["state_type"] == "PENDING" and run["infrastructure_pid"]]

    taken = until(starting, 120, "a shard that starts")[0]
    process = int(taken["infrastructure_pid"].rpartition(":")[2])
    workers = [topology.services[f"worker-{k}"] for k in (1, 2)]
    worker = next(one for one in workers if process in one.family())
    worker.kill()
    worker.start()
    complete(topology, batch, store)
    assert batch.again == 0
    ended = {run["id"]: run["state_type"] for run in batch.shards()}
    assert ended[taken["id"]] == "CRASHED"


def test_a_worker_killed_in_mid_batch_loses_nothing(topology, api, store):
    batch = Batch(api, domes(topology.app, 300, MODELS // 2))
    batch.halfway(store)
    worker = topology.services["worker-1"]
    worker.kill()
    worker.start()  # as `restart: unless-stopped` does
    complete(topology, batch, store)
    assert batch.again == 0, "the batch itself has noticed and gone on"
    assert "CRASHED" in {run["state_type"] for run in batch.shards()}
