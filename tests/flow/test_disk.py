"""The flow on disks that are full or can only be read: rows tell of it, and it goes on once there is room."""

import subprocess
import sys

import pandas as pd
import pytest

from drl_meshgen.store import Store
from drl_meshgen.store.verify import verify
from flows.batch import batch
from flows.mesh import mesh, outcomes_of
from flows.runners import RunnerKind

pytestmark = pytest.mark.usefixtures("server")
SMALL = {"target_quads": 100, "triangles": 5000}


def meshed(store):
    state = mesh(["hemisphere"], **SMALL, store=str(store), compare=False, return_state=True)
    (outcome,) = outcomes_of(state)
    return outcome, state


def batched(out, store):
    given = {**SMALL, "pictures": False, "runner": RunnerKind.HERE}
    return batch(["hemisphere"], str(out), **given, store=str(store), return_state=True)


def test_a_full_disk_for_the_store_is_told_in_a_row_and_tried_again(small_disk, tmp_path):
    store, out = small_disk.place / "store", tmp_path / "out"
    assert batched(out, store).is_failed()
    (row,) = pd.read_parquet(out / "batch.parquet").to_dict("records")
    assert row["status"] == "internal error"
    assert row["sentence"].startswith("hemisphere: stage ")
    assert "No space left on device" in row["sentence"]
    assert verify(Store(store)).damages == ()
    small_disk.change("size=30m")
    assert batched(out, store).is_completed()
    assert list(pd.read_parquet(out / "batch.parquet")["status"]) == ["fine"]
    assert verify(Store(store)).damages == ()


def test_a_full_disk_for_the_batch_leaves_a_sound_store_and_the_batch_goes_on(small_disk, tmp_path):
    store, out = tmp_path / "store", small_disk.place / "out"
    small_disk.change("size=40k")
    assert batched(out, store).is_failed()
    assert verify(Store(store)).damages == ()
    small_disk.change("size=30m")
    assert batched(out, store).is_completed()
    assert (out / "meshes/hemisphere/mesh.vtu").is_file()


def test_a_store_that_can_only_be_read_serves_what_it_has(small_disk, tmp_path):
    store = small_disk.place / "store"
    small_disk.change("size=30m")
    command = ["-m", "drl_meshgen.cli", "mesh", "hemisphere", "--target-quads", "100", "--triangles", "5000"]
    command += ["--no-pictures", "--out", str(tmp_path / "out"), "--store", str(store)]
    subprocess.run([sys.executable, *command], check=True)  # a process of its own, as it keeps files open
    small_disk.change("ro")
    served, state = meshed(store)
    assert (served.failure, served.exit_code, len(served.refs)) == ("", 0, 12)
    assert state.is_failed()
    assert state.message.startswith("no report: Read-only file system: ")


def test_a_store_that_can_only_be_read_refuses_the_rest_in_one_sentence(small_disk):
    (small_disk.place / "store/records").mkdir(parents=True)
    small_disk.change("ro")
    refused, _ = meshed(small_disk.place / "store")
    assert refused.failure.startswith("hemisphere: stage model: Read-only file system")
    assert "\n" not in refused.failure
