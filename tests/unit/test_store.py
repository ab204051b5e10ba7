import errno
import json
import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from drl_meshgen.store import ArtifactRef, DamagedArtifactError, Recipe, Store
from drl_meshgen.store.canonical import file_digest

SOURCE = "0" * 64


def recipe(**options):
    return Recipe.of("toy", 1, SOURCE, {}, options)


def writer(**files):
    def compute(folder):
        for name, text in files.items():
            (folder / f"{name}.txt").write_text(text)

    return compute


def refuse(_folder):
    pytest.fail("computed although the store has it")


def object_files(store):
    return sorted(p for p in (store.root / "objects").rglob("*") if p.is_file())


def test_a_second_run_computes_nothing_and_gives_the_same_reference(store):
    first = store.run(recipe(a=1), writer(x="one", y="two"))
    assert store.run(recipe(a=1), refuse) == first


def test_outputs_are_read_back_under_their_names(store):
    ref = store.run(recipe(), writer(x="one", y="two"))
    with store.folder(ref) as folder:
        assert {p.name: p.read_text() for p in folder.iterdir()} == {"x.txt": "one", "y.txt": "two"}
    assert not folder.exists()


def test_an_exported_artifact_can_be_changed_without_harm(store, tmp_path):
    ref = store.run(recipe(), writer(x="one", y="two"))
    store.export(ref, tmp_path / "out")
    (tmp_path / "out/x.txt").write_text("changed")
    (tmp_path / "out/mine.txt").write_text("mine")
    assert store.find(ref.stage, ref.key) == ref
    store.export(ref, tmp_path / "out")
    found = {p.name: p.read_text() for p in (tmp_path / "out").iterdir()}
    assert found == {"x.txt": "one", "y.txt": "two", "mine.txt": "mine"}


def test_objects_are_named_by_their_content_and_read_only(store):
    store.run(recipe(), writer(x="one", y="one"))
    (path,) = object_files(store)
    assert path.name == file_digest(path)
    assert path.parent.name == path.name[:2]
    assert path.stat().st_mode & 0o222 == 0


def test_other_options_are_computed_on_their_own(store):
    assert store.run(recipe(a=1), writer(x="one")).key != store.run(recipe(a=2), writer(x="one")).key


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove"])
def test_a_damaged_object_is_computed_again_and_healed(store, damage):
    ref = store.run(recipe(), writer(x="one", y="two"))
    path = store.objects.path(ref.outputs["y.txt"])
    content = bytearray(path.read_bytes())
    path.unlink()
    if damage == "flip":
        content[0] ^= 1
        path.write_bytes(content)
    elif damage == "truncate":
        path.write_bytes(content[:-1])
    assert store.find(ref.stage, ref.key) is None
    with pytest.raises(DamagedArtifactError, match=r"y\.txt"), store.folder(ref):
        pass
    assert store.run(recipe(), writer(x="one", y="two")) == ref
    assert store.run(recipe(), refuse) == ref


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: text[:0],
        lambda text: f"{text[:0]}null",
        lambda text: text.replace("x.txt", "z.txt"),
        lambda text: text.replace('"version": 1', '"version": 2'),
        lambda text: text.replace("x.txt", "../../x.txt"),
    ],
)
def test_a_damaged_record_is_a_miss(store, damage):
    ref = store.run(recipe(), writer(x="one"))
    path = store.record_path(ref.stage, ref.key)
    text = path.read_text()
    path.unlink()
    path.write_text(damage(text))
    assert store.find(ref.stage, ref.key) is None
    assert store.run(recipe(), writer(x="one")) == ref


def test_a_record_of_another_key_is_a_miss(store):
    one, two = store.run(recipe(a=1), writer(x="one")), store.run(recipe(a=2), writer(x="two"))
    store.record_path("toy", two.key).unlink()
    store.record_path("toy", one.key).rename(store.record_path("toy", two.key))
    assert store.find("toy", two.key) is None


def test_timing_stays_outside_the_hashed_part(store):
    ref = store.run(recipe(), writer(x="one"))
    path = store.record_path(ref.stage, ref.key)
    record = json.loads(path.read_text())
    record["seconds"] = 12.5
    path.unlink()
    path.write_text(json.dumps(record))
    assert store.find(ref.stage, ref.key) == ref
    assert store.seconds(ref) == 12.5


def test_times_of_parts_are_kept_beside_the_artifact_and_change_nothing_in_it(store):
    def compute(folder):
        (folder / "x.txt").write_text("one")
        return {"rival": 3.5}

    ref = store.run(recipe(), compute)
    assert store.parts(ref) == {"rival": 3.5}
    assert ref == store.run(recipe(), writer(x="one"))
    assert store.parts(store.run(recipe(a=2), writer(x="one"))) == {}


def test_a_failing_computation_leaves_nothing(store):
    def compute(folder):
        (folder / "x.txt").write_text("half")
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        store.run(recipe(), compute)
    assert store.find("toy", recipe().key) is None
    assert not object_files(store)
    assert not list((store.root / "tmp").iterdir())


def test_a_computation_without_files_is_refused(store):
    with pytest.raises(ValueError, match="wrote no file"):
        store.run(recipe(), lambda _folder: None)


def test_a_link_among_the_outputs_is_refused(store):
    with pytest.raises(ValueError, match="not a plain file"):
        store.run(recipe(), lambda folder: (folder / "x.txt").symlink_to("/etc/hostname"))


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "..", ".", "", "a//b", ".hidden", "a\\b", "a\0b", "a\n"])
def test_names_cannot_leave_the_store(name):
    with pytest.raises(ValueError, match="is not a name"):
        ArtifactRef("toy", SOURCE, {name: SOURCE})


@pytest.mark.parametrize("stage", ["../toy", "Toy", "", "a/b", "toy\n"])
def test_stage_names_cannot_leave_the_store(store, stage):
    with pytest.raises(ValueError, match="is not a stage name"):
        store.record_path(stage, SOURCE)


@pytest.mark.parametrize("sha", ["../" + "0" * 61, "0" * 63, "G" * 64, ""])
def test_digests_cannot_leave_the_store(store, sha):
    with pytest.raises(ValueError, match="is not a SHA-256"):
        store.objects.path(sha)


def test_a_reference_survives_json(store):
    ref = store.run(recipe(), writer(x="one"))
    assert ArtifactRef.from_json(ref.to_json()) == ref


def test_equal_content_of_an_input_gives_an_equal_key(store):
    one, two = store.run(recipe(a=1), writer(x="same")), store.run(recipe(a=2), writer(x="same"))
    assert Recipe.of("next", 1, SOURCE, {"toy": one}, {}).key == Recipe.of("next", 1, SOURCE, {"toy": two}, {}).key


def test_a_store_that_can_only_be_read_gives_what_it_has(store, monkeypatch):
    ref = store.run(recipe(), writer(x="one"))
    before = {path: path.stat().st_mtime_ns for path in store.root.rglob("*")}

    def refusing(*_arguments, **_more):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("drl_meshgen.store.store.present", lambda _folder: None)
    monkeypatch.setattr("os.utime", refusing)
    assert store.run(recipe(), refuse) == ref
    with store.folder(ref) as folder:
        assert (folder / "x.txt").read_text() == "one"
        assert store.root not in folder.parents
    assert {path: path.stat().st_mtime_ns for path in store.root.rglob("*")} == before


def test_the_environment_names_the_store(monkeypatch, tmp_path):
    monkeypatch.setenv("DRL_MESHGEN_STORE", str(tmp_path))
    assert Store().root == tmp_path
    assert Store("other").root == Path("other")
    monkeypatch.delenv("DRL_MESHGEN_STORE")
    assert Store().root == Path("artifacts")


def _slow_run(root, log, started=None):
    def compute(folder):
        with log.open("a") as handle:
            handle.write("computed\n")
        (folder / "x.txt").write_text("o")
        if started is not None:
            started.set()
            time.sleep(60)
        time.sleep(0.3)
        (folder / "x.txt").write_text("one")

    Store(root).run(recipe(), compute)


SPAWN = multiprocessing.get_context("spawn")


def test_two_processes_with_one_key_compute_once(store, tmp_path):
    log = tmp_path / "log"
    both = [SPAWN.Process(target=_slow_run, args=(store.root, log)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join()
    assert [process.exitcode for process in both] == [0, 0]
    assert log.read_text() == "computed\n"


def test_a_killed_computation_leaves_no_half_object_and_no_lock(store, tmp_path):
    started = SPAWN.Event()
    victim = SPAWN.Process(target=_slow_run, args=(store.root, tmp_path / "log", started))
    victim.start()
    assert started.wait(30)
    os.kill(victim.pid, signal.SIGKILL)
    victim.join()
    assert store.find("toy", recipe().key) is None
    assert not object_files(store)
    ref = store.run(recipe(), writer(x="one"))
    assert list(ref.outputs) == ["x.txt"]
    assert not list((store.root / "tmp").iterdir())
