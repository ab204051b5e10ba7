"""Batches: which models, with which options, what is kept of an earlier run, and when a watched file is whole."""

import os
from dataclasses import replace

import pandas as pd
import pytest

from drl_meshgen.batch import TABLE, Job, Row, Rows, Status, Watch, collect, keys_of
from drl_meshgen.batch.rows import METRICS, table_of
from drl_meshgen.errors import InputError
from drl_meshgen.pipeline import MeshOptions, run
from drl_meshgen.store import Store

OPTIONS = MeshOptions()


@pytest.fixture
def folder(tmp_path):
    for name in ("b.stl", "a.ply", "deep/a.ply", ".hidden/c.ply", "deep/.d.ply", "notes.txt"):
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / name).write_text(name)
    return tmp_path / "in"


def manifest(folder, rows, name="jobs.csv"):
    path = folder / name
    table = pd.DataFrame(rows)
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
    else:
        table.to_parquet(path)
    return str(path)


def test_a_folder_stands_for_the_surfaces_below_it_in_order(folder):
    jobs = collect([str(folder)], OPTIONS)
    assert [job.label for job in jobs] == ["a.ply", "b.stl", "deep/a.ply"]
    assert [job.name for job in jobs] == ["a", "b", "a-2"]


def test_patterns_files_and_names_are_taken_as_given(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert [job.label for job in collect(["**/*.ply"], OPTIONS)] == ["a.ply", "deep/a.ply"]
    jobs = collect(["random:7", "none.stl", "hemisphere"], OPTIONS)
    assert [(job.name, job.source) for job in jobs] == [
        ("random-7", "random:7"),
        ("none", "none.stl"),
        ("hemisphere", "hemisphere"),
    ]


def test_a_folder_or_pattern_without_a_surface_is_bad_input(tmp_path):
    for model in (str(tmp_path), str(tmp_path / "*.stl")):
        with pytest.raises(InputError, match="holds no surface"):
            collect([model], OPTIONS)


@pytest.mark.parametrize("name", ["../../etc/x.stl", "a/b\nc.stl", "-rf.stl", "ü" * 300 + ".stl", "..stl", "a.b.stl"])
def test_no_name_leaves_the_folder_of_the_batch(name):
    (job,) = collect([name], OPTIONS)
    assert job.name
    assert len(job.name) <= 80
    assert not set(job.name) & set("/\\\0\n.")
    assert not job.name.startswith("-")


@pytest.mark.parametrize("kind", ["jobs.csv", "jobs.parquet"])
def test_a_row_of_a_manifest_changes_its_own_options(folder, kind):
    path = manifest(
        folder,
        [
            {"model": "a.ply", "name": "first", "target_quads": 300, "smoothing.aspect_weight": None},
            {"model": "hemisphere", "name": None, "target_quads": None, "smoothing.aspect_weight": 0.5},
        ],
        kind,
    )
    first, second = collect([path], OPTIONS.sized(target_edge=0.3))
    assert (first.name, first.label, first.source) == ("first", "a.ply", str(folder / "a.ply"))
    assert first.options == OPTIONS.sized(300)
    assert second.options.decompose.target_edge == 0.3
    assert second.options.smoothing.aspect_weight == 0.5
    assert second.source == "hemisphere"


def test_policy_files_of_a_manifest_are_beside_it_and_names_are_names(folder):
    path = manifest(folder, {"model": ["a.ply"] * 3, "subdomain.policy": ["own.safetensors", "rule", None]})
    policies = [job.options.subdomain.policy for job in collect([path], OPTIONS)]
    assert policies == [str(folder / "own.safetensors"), "rule", OPTIONS.subdomain.policy]


def test_a_bad_row_is_refused_alone_and_says_where_it_is(folder):
    path = manifest(folder, {"model": ["a.ply", "", "b.stl"], "seed": ["x", 1, 2], "name": ["../up", None, None]})
    bad, empty, good = collect([path], OPTIONS)
    assert bad.refusal == "jobs.csv: row 1: seed cannot be 'x'; it is a whole number"
    assert bad.name == "up"
    assert empty.refusal == "jobs.csv: row 2: names no model"
    assert good.refusal == ""


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "cannot be read as a table"),
        (b"\xff\xfe\x00", "cannot be read as a table"),
        (b"file\na.ply\n", "has no column model"),
        (b"model\n", "has no rows"),
        (b"model,decompose.nothing\na.ply,1\n", "unknown column decompose.nothing"),
        (b"model,limit\na.ply,1\n", "unknown column limit"),
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_manifest_that_cannot_be_used_is_bad_input(tmp_path, content, sentence, suffix):
    path = tmp_path / f"jobs{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=sentence if suffix == ".csv" else "cannot be read as a table"):
        collect([str(path)], OPTIONS)


def key_of(job, **more):
    return keys_of([job], **more)[job.name]


def test_a_key_changes_with_content_options_and_name_and_with_nothing_else(folder):
    (job,) = collect([str(folder / "b.stl")], OPTIONS)
    key = key_of(job)
    os.utime(folder / "b.stl")
    assert key_of(job) == key
    (sized,) = collect([str(folder / "b.stl")], OPTIONS.sized(77))
    (folder / "b.stl").write_text("other")
    assert len({key, key_of(job), key_of(sized), key_of(job, compare=True)}) == 4
    (folder / "b.stl").unlink()
    assert key_of(job) not in {"", key}


def test_a_key_follows_the_content_of_files_that_options_name_even_if_they_are_gone(folder, tmp_path):
    policy = tmp_path / "own.safetensors"
    options = replace(OPTIONS, subdomain=replace(OPTIONS.subdomain, policy=str(policy)))
    (job,) = collect([str(folder / "b.stl")], options)
    keys = {key_of(job)}
    for content in ("one", "two"):
        policy.write_text(content)
        keys.add(key_of(job))
    assert len(keys) == 3
    policy.write_text("one")
    assert key_of(job) in keys


def job(name="a"):
    return Job(name, f"{name}.ply", f"{name}.ply", OPTIONS, 5000)


def test_rows_read_back_as_written_and_final_ones_are_kept(tmp_path):
    rows = Rows(tmp_path, Store(tmp_path / "store"))
    row = Row("key", Status.REFUSED, 3, "a: is bad", 1.5, {"quads": 4.0}, {}, "data:")
    rows.begin("a")
    assert rows.begun("a")
    rows.write("a", row)
    assert not rows.begun("a")
    assert rows.read("a") == row == rows.kept(job(), "key")
    assert rows.kept(job(), "another key") is None
    for status in (Status.INTERNAL, Status.TOO_LONG, Status.DIED):
        rows.write("a", Row("key", status, 1, "a: no luck"))
        assert rows.kept(job(), "key") is None


def test_a_row_whose_artifacts_are_gone_is_not_kept(tmp_path):
    rows = Rows(tmp_path, Store(tmp_path / "store"))
    rows.write("a", Row("key", Status.FINE, 0, artifacts={"quality": "0" * 64}))
    assert rows.kept(job(), "key") is None


def test_a_row_whose_mesh_is_gone_from_the_store_is_not_kept(tmp_path):
    store = Store(tmp_path / "store")
    refs = run("hemisphere", OPTIONS.sized(100), triangles=5000, store=store).refs
    rows = Rows(tmp_path, store)
    rows.write("a", Row("key", Status.FINE, 0, artifacts={stage: ref.key for stage, ref in refs.items()}))
    assert rows.kept(job(), "key") is not None
    store.objects.path(refs["smoothing"].outputs["mesh.vtu"]).unlink()
    assert rows.kept(job(), "key") is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"status": "odd"}', b"\xff"])
def test_a_damaged_row_is_none(tmp_path, content):
    rows = Rows(tmp_path, Store(tmp_path / "store"))
    rows.write("a", Row("key", Status.FINE, 0))
    (tmp_path / "rows/a.json").write_bytes(content)
    assert rows.read("a") is None


def test_the_table_has_the_same_columns_whatever_came_of_the_models(tmp_path):
    none = table_of([])
    failed = table_of([(job(), Row("key", Status.FAILED, 1, "a: no"))])
    assert list(none.columns) == list(failed.columns)
    assert list(failed[["name", "source", "status", "exit_code"]].iloc[0]) == ["a", "a.ply", "failed", 1]
    assert failed["quads"].isna().all()
    rows = Rows(tmp_path, Store(tmp_path / "store"))
    table = tmp_path / TABLE
    rows.write_table([job()])
    assert not table.exists()
    rows.write("a", Row("key", Status.FAILED, 1, "a: no"))
    rows.write_table([job()])
    before = table.read_bytes()
    rows.write_table([job(), job("b")])
    assert table.read_bytes() == before


def test_the_metrics_of_the_table_are_those_of_a_mesh():
    assert tuple(run("hemisphere", OPTIONS.sized(100), triangles=5000)["quality"].metrics) == METRICS


def test_a_watched_file_is_ready_once_it_stands_still(tmp_path):
    path, watch = tmp_path / "a.stl", Watch()
    path.write_text("begun")
    assert watch.settled([str(path), "hemisphere"]) == ("hemisphere",)
    path.write_text("begun and going on")
    assert watch.settled([str(path), "hemisphere"]) == ()
    assert watch.settled([str(path)]) == (str(path),)
    assert watch.settled([str(path)]) == ()
    path.write_text("changed")
    assert watch.settled([str(path)]) == ()
    assert watch.settled([str(path)]) == (str(path),)
