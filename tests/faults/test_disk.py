"""Disks that are full or can only be read: one sentence, a sound store, and a run that ends once there is room."""

import os
import resource
import subprocess
import sys
from pathlib import Path

from drl_meshgen.store import Store
from drl_meshgen.store.verify import verify

SMALL = ["--triangles", "5000", "--no-pictures"]


def mesh(out, store, quads=100, **more):
    sized = ["--target-quads", str(quads), *SMALL]
    return subprocess.run(
        [sys.executable, "-m", "drl_meshgen.cli", "mesh", "hemisphere", *sized, "--out", out, "--store", store],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        **more,
    )


def sound(store):
    return verify(Store(store)).damages == ()


def test_a_full_disk_is_told_in_one_sentence_and_the_run_ends_once_there_is_room(small_disk, tmp_path):
    store = small_disk.place / "store"
    done = mesh(tmp_path / "out", store)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [line for line in done.stderr.splitlines() if "No space left on device" in line]
    assert len(done.stderr.splitlines()) == 1
    assert sound(store)
    assert not (tmp_path / "out/hemisphere").exists()
    kept = len(list((store / "records").glob("*/*")))
    assert kept > 0
    small_disk.change("size=30m")
    done = mesh(tmp_path / "out", store)
    assert done.returncode == 0, done.stderr
    assert sound(store)


def test_a_full_disk_for_the_results_leaves_nothing_half_written(small_disk, tmp_path):
    store = tmp_path / "store"
    small_disk.change("size=60k")
    done = mesh(small_disk.place / "out", store)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert list((small_disk.place / "out").iterdir()) == []
    assert sound(store)


def test_a_limit_of_the_size_of_files_is_told_in_one_sentence(tmp_path):
    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))

    (tmp_path / "store/records").mkdir(parents=True)
    done = mesh(tmp_path / "out", tmp_path / "store", preexec_fn=limited)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert sound(tmp_path / "store")
    assert mesh(tmp_path / "out", tmp_path / "store").returncode == 0


def test_a_store_that_can_only_be_read_serves_what_it_has_and_says_what_it_cannot(small_disk, tmp_path):
    store = small_disk.place / "store"
    small_disk.change("size=30m")
    assert mesh(tmp_path / "out", store).returncode == 0
    small_disk.change("ro")
    warm = mesh(tmp_path / "again", store)
    assert warm.returncode == 0, warm.stderr
    assert (tmp_path / "again/hemisphere/mesh.vtu").is_file()
    cold = mesh(tmp_path / "cold", store, quads=120)
    assert cold.returncode == 1
    assert len(cold.stderr.splitlines()) == 1
    assert "Read-only file system" in cold.stderr
