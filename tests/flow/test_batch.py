"""The batch flow: a bad model stops no other, and what was done is not done again, whatever ended the last run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from drl_meshgen.batch import Row, Status, collect
from drl_meshgen.export import write_surface_ply
from drl_meshgen.models.loading import generate
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.store import Store
from drl_meshgen.store.verify import verify
from flows.batch import Batch, Work, _mesh_in_shards, batch
from flows.runners import RunnerKind, shards
from tests.flow.runs import states

pytestmark = pytest.mark.usefixtures("server")
SMALL = {"target_quads": 100, "triangles": 5000, "pictures": False}


@pytest.fixture
def models(tmp_path):
    """Return a folder with one surface that can be meshed and one that cannot."""
    folder = tmp_path / "models"
    folder.mkdir()
    write_surface_ply(folder / "cap.ply", generate("hemisphere", 5000))
    (folder / "bad.stl").write_text("solid")
    return folder


def here(models, out, **more):
    state = batch(
        [str(model) for model in models], str(out), **{**SMALL, "runner": RunnerKind.HERE, **more}, return_state=True
    )
    return state, pd.read_parquet(out / "batch.parquet").set_index("name")


def changed(out):
    return {path.stem: path.stat().st_mtime_ns for path in (out / "rows").glob("*.json")}


def test_a_bad_model_stops_no_other_and_a_second_run_does_only_what_changed(models, tmp_path):
    out, store = tmp_path / "out", str(tmp_path / "store")
    state, table = here([models, "hemisphere"], out, store=store)
    assert state.is_failed()
    assert "1 of 3 models failed: bad" in state.message
    assert list(table.index) == ["bad", "cap", "hemisphere"]
    assert list(table["status"]) == ["refused", "fine", "fine"]
    assert table["sentence"]["bad"].startswith("bad.stl: ")
    assert sorted(path.name for path in (out / "meshes").iterdir()) == ["cap", "hemisphere"]
    assert (out / "meshes/cap/mesh.vtu").is_file()
    before, content = changed(out), (out / "batch.parquet").read_bytes()

    here([models, "hemisphere"], out, store=store)
    assert changed(out) == before
    assert (out / "batch.parquet").read_bytes() == content

    write_surface_ply(models / "bad.stl", generate("hemisphere", 5000))
    (models / "bad.stl").rename(models / "good.ply")
    (out / "rows/cap.json").write_text("{")
    _, table = here([models, "hemisphere"], out, store=store)
    assert list(table["status"]) == ["fine", "fine", "fine"]
    assert changed(out)["hemisphere"] == before["hemisphere"]
    assert changed(out)["cap"] != before["cap"]
    assert verify(Store(store)).damages == ()


@pytest.mark.usefixtures("models")
def test_a_row_that_names_a_policy_file_that_is_not_there_is_refused_alone(tmp_path):
    manifest = tmp_path / "jobs.csv"
    manifest.write_text("model,name,subdomain.policy\nmodels/cap.ply,lost,none.safetensors\nmodels/cap.ply,good,\n")
    _, table = here([manifest], tmp_path / "out", store=str(tmp_path / "store"))
    assert table["status"].to_dict() == {"lost": "refused", "good": "fine"}
    assert "none.safetensors" in table["sentence"]["lost"]


def test_more_models_than_many_are_a_task_run_each_and_have_the_same_rows(
    models, server, tmp_path, monkeypatch, wait_for
):
    _, table = here([models], tmp_path / "out", store=str(tmp_path / "store"))
    monkeypatch.setattr("flows.batch.MANY", 0)
    _, other = here([models], tmp_path / "many", store=str(tmp_path / "more"))
    pd.testing.assert_frame_equal(table.drop(columns="seconds"), other.drop(columns="seconds"))
    ended = {"mesh bad": "Failed", "mesh cap": "Completed"}
    wait_for(lambda: states(server), ended)


def test_time_that_is_over_ends_a_model_and_is_tried_again(models, tmp_path):
    out, store = tmp_path / "out", str(tmp_path / "store")
    _, table = here([models / "cap.ply"], out, store=store, limit=0.01)
    assert list(table["status"]) == ["too long"]
    assert "when 0.01 seconds were over" in table["sentence"]["cap"]
    _, table = here([models / "cap.ply"], out, store=store)
    assert list(table["status"]) == ["fine"]


def command(out, store, models, *more):
    """Start the command line in a process group of its own."""
    options = ["--out", str(out), "--store", str(store), "--target-quads", "100", "--no-pictures", "--workers", "1"]
    return subprocess.Popen(
        [sys.executable, "-m", "flows.batch", *map(str, models), *options, *more],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def workers_of(process):
    """Return the processes that mesh for a command."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == process.pid and b"spawn_main" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except (OSError, ValueError):
            continue
    return found


def runs(pid):
    """Tell whether a process runs; one that ended and that nobody waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(process, told, seconds=120):
    end = time.monotonic() + seconds
    while not told():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize("runner", ["processes", "dask"])
def test_a_model_whose_process_always_dies_is_told_and_the_others_are_meshed(
    models, server, tmp_path, monkeypatch, runner
):
    if runner == "dask":
        pytest.importorskip("prefect_dask")
    monkeypatch.setenv("PREFECT_API_URL", server)
    out, store = tmp_path / "out", tmp_path / "store"
    write_surface_ply(models / "victim.ply", generate("hemisphere", 6000))
    process = command(out, store, [models / "victim.ply", models / "cap.ply"], "--runner", runner)
    begun, last = out / "rows/victim.begun", 0
    while process.poll() is None:
        if begun.exists() and begun.stat().st_mtime_ns > last:
            last = begun.stat().st_mtime_ns
            for worker in workers_of(process):
                os.kill(worker, signal.SIGKILL)
        time.sleep(0.02)
    told, errors = process.communicate(timeout=120)
    assert process.returncode == 5, errors
    assert "victim: the process that meshed it ended without a word" in errors
    table = pd.read_parquet(out / "batch.parquet").set_index("name")
    assert table["status"].to_dict() == {"victim": "died", "cap": "fine"}
    assert "2 models: 1 died, 1 fine" in told
    assert verify(Store(store)).damages == ()


def test_a_batch_that_was_killed_goes_on_where_it_was(models, server, tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", server)
    out, store = tmp_path / "out", tmp_path / "store"
    write_surface_ply(models / "second.ply", generate("hemisphere", 6000))
    given = [models / "cap.ply", models / "second.ply"]
    process = command(out, store, given)
    until(process, (out / "rows/second.begun").exists)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    before = changed(out)
    assert list(before) == ["cap"]
    _, table = here(given, out, store=str(store), triangles=25_000)
    assert list(table["status"]) == ["fine", "fine"]
    assert changed(out)["cap"] == before["cap"]
    assert verify(Store(store)).damages == ()


def test_a_batch_that_is_told_to_end_ends_at_once_with_its_processes(models, server, tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", server)
    out, store = tmp_path / "out", tmp_path / "store"
    process = command(out, store, [models / "cap.ply"])
    until(process, (out / "rows/cap.begun").exists)
    meshing = workers_of(process)
    process.terminate()
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    assert errors.endswith("ended; the same command goes on from here\n")
    assert not [pid for pid in meshing if runs(pid)]


def test_a_batch_that_is_told_to_end_leaves_the_table_of_what_was_done(models, server, tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", server)
    out = tmp_path / "out"
    write_surface_ply(models / "second.ply", generate("hemisphere", 6000))
    process = command(out, tmp_path / "store", [models / "cap.ply", models / "second.ply"])
    until(process, (out / "rows/second.begun").exists)
    process.terminate()
    process.communicate(timeout=120)
    assert process.returncode == 130
    assert pd.read_parquet(out / "batch.parquet")["name"].tolist() == ["cap"]


def test_a_watched_folder_is_meshed_as_it_fills(models, server, tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", server)
    out, store = tmp_path / "out", tmp_path / "store"
    (models / "bad.stl").unlink()
    process = command(out, store, [models], "--watch", "0.5")
    until(process, (out / "rows/cap.json").exists)
    (models / "new.stl").write_text("solid")
    until(process, (out / "rows/new.json").exists)
    until(process, lambda: len(pd.read_parquet(out / "batch.parquet")) == 2)
    process.terminate()
    told, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "ended; the same command goes on from here" in errors
    assert "watching" in told


def test_shards_hold_every_name_once_and_are_of_about_one_size():
    names = [str(k) for k in range(205)]
    groups = shards(names, 100)
    assert sorted(name for group in groups for name in group) == sorted(names)
    assert {len(group) for group in groups} <= {68, 69}
    assert shards([], 100) == []


def test_only_the_model_that_ends_its_shards_is_left_out_and_the_others_stay_together(tmp_path, monkeypatch):
    jobs = collect([f"random:{seed}" for seed in range(9)], MeshOptions())
    own = Batch(jobs, Work(str(tmp_path), str(tmp_path / "store")))
    rounds = []

    def run(groups, _deployment, _given):
        rounds.append([list(group) for group in groups])
        for group in groups:
            for name in group:
                own.rows.begin(name)
                if name == "random-4":  # its process ends here
                    break
                own.rows.write(name, Row(own.keys[name], Status.FINE, 0))

    monkeypatch.setattr("flows.batch._run_shards", run)
    _mesh_in_shards(own, own.pending, 3, "batch/shard", {})
    assert rounds[1:] == [[["random-4"], ["random-7"]]]
    assert own.rows.read("random-4").status is Status.DIED
    assert own.lost([job.name for job in jobs]) == []


def test_shards_that_nobody_runs_are_given_up(tmp_path, monkeypatch):
    own = Batch(collect(["random:1", "random:2"], MeshOptions()), Work(str(tmp_path), str(tmp_path / "store")))
    rounds = []
    monkeypatch.setattr("flows.batch._run_shards", lambda groups, *_: rounds.append(len(groups)))
    _mesh_in_shards(own, own.pending, 1, "batch/shard", {})
    assert rounds == [2, 2]
    assert {own.rows.read(f"random-{k}").status for k in (1, 2)} == {Status.DIED}


def test_a_dask_cluster_gives_the_same_rows(models, tmp_path):
    pytest.importorskip("prefect_dask")
    _, table = here([models], tmp_path / "here", store=str(tmp_path / "store"))
    _, other = here([models], tmp_path / "dask", store=str(tmp_path / "more"), runner=RunnerKind.DASK, workers=1)
    pd.testing.assert_frame_equal(table.drop(columns="seconds"), other.drop(columns="seconds"))
