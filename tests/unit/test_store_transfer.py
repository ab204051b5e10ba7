"""Copies of artifacts between stores, in folders and through fsspec."""

import builtins
import json
import uuid

import pytest

from drl_meshgen.store import Store, execute
from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.remote import remote_at
from drl_meshgen.store.transfer import LARGEST_RECORD, pull, push
from drl_meshgen.store.verify import verify
from tests.flow.toys import STAGES, NumberOptions


@pytest.fixture
def other(tmp_path):
    return Store(tmp_path / "other")


@pytest.fixture(params=["folder", "url", "file url"])
def place(request, tmp_path):
    where = tmp_path / "remote"
    return {"folder": str(where), "url": f"memory://{uuid.uuid4()}/deep", "file url": where.as_uri()}[request.param]


def test_what_was_pushed_is_pulled_under_the_same_ids(run, store, refs, other, place):
    assert run(store, "push", place).exit_code == 0
    told = run(other, "pull", place)
    assert told.exit_code == 0
    assert "fetched 3 artifacts, 3 objects" in told.stdout
    assert execute(STAGES, store=other).refs == refs
    assert all(timing.cached for timing in execute(STAGES, store=other).timings)
    assert verify(other).damages == ()


def test_only_what_is_missing_is_copied(store, refs, other, place):
    assert push(store, remote_at(place)).artifacts == 3
    assert push(store, remote_at(place)).artifacts == 0
    execute(STAGES, {"number": NumberOptions("four")}, store=store)
    assert push(store, remote_at(place)).artifacts == 3
    assert pull(other, remote_at(place)).artifacts == 6
    assert pull(other, remote_at(place)).artifacts == 0
    other.objects.path(refs["double"].outputs["value.json"]).unlink()
    assert pull(other, remote_at(place)).artifacts == 1


def test_one_artifact_is_pushed_with_all_it_was_made_from(run, store, refs, other, place):
    execute(STAGES, {"number": NumberOptions("four")}, store=store)
    assert "sent 3 artifacts" in run(store, "push", place, "--only", refs["total"].key[:12]).stdout
    run(other, "pull", place)
    assert execute(STAGES, store=other).refs == refs
    assert run(store, "push", place, "--only", "0000").exit_code == 3


def test_one_artifact_is_pulled_with_all_it_was_made_from(run, store, refs, other, place):
    execute(STAGES, {"number": NumberOptions("four")}, store=store)
    run(store, "push", place)
    told = run(other, "pull", place, "--only", refs["double"].key[:12])
    assert "fetched 2 artifacts" in told.stdout
    assert {record.ref.key for record in Catalogue.of(other).records} == {refs["number"].key, refs["double"].key}
    assert run(other, "pull", place, "--only", "0000").exit_code == 3


def test_the_same_run_on_two_machines_has_nothing_to_copy(store, other):
    execute(STAGES, store=store)
    execute(STAGES, store=other)
    assert push(store, remote_at(str(other.root))).artifacts == 0
    assert pull(store, remote_at(str(other.root))).artifacts == 0


@pytest.mark.parametrize("change", [lambda c: c[:-1], lambda c: c[:-1] + b"7", lambda _c: b"", None])
def test_a_damaged_object_is_neither_pulled_nor_pushed(run, store, refs, other, change):
    path = store.objects.path(refs["double"].outputs["value.json"])
    content = path.read_bytes()
    path.unlink()
    if change is not None:
        path.write_bytes(change(content))
    told = run(other, "pull", store.root)
    assert told.exit_code == 1
    assert "is missing or damaged there" in told.stderr
    assert other.look_up("double", refs["double"].key) is None
    assert other.look_up("total", refs["total"].key) == refs["total"]
    assert verify(other).damages == ()
    assert not list((other.root / "tmp").iterdir())
    third = Store(other.root.parent / "third")
    assert run(store, "push", third.root).exit_code == 1
    assert verify(third).damages == ()


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c[: len(c) // 2],
        lambda c: c.replace(b"value.json", b"../../out.json"),
        lambda c: c.replace(b'"version": 1', b'"version": 2'),
        lambda _c: b" " * (LARGEST_RECORD + 1),
    ],
)
def test_a_damaged_record_is_not_pulled_and_is_pushed_anew(store, refs, other, change):
    push(store, remote_at(str(other.root)))
    path = other.record_path("double", refs["double"].key)
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(change(content))
    third = Store(other.root.parent / "third")
    assert pull(third, remote_at(str(other.root))).artifacts == 2
    assert sorted(p.name for p in third.root.iterdir()) == ["locks", "objects", "records", "tmp"]
    assert third.look_up("double", refs["double"].key) is None
    if len(path.read_bytes()) != len(content):
        assert push(store, remote_at(str(other.root))).artifacts == 1
        assert other.look_up("double", refs["double"].key) == refs["double"]


def test_a_half_written_object_is_sent_again(store, refs, other):
    push(store, remote_at(str(other.root)))
    path = other.objects.path(refs["total"].outputs["value.json"])
    path.unlink()
    path.write_bytes(b"9")
    assert push(store, remote_at(str(other.root))).objects == 1
    assert verify(other).damages == ()


@pytest.mark.usefixtures("refs")
def test_names_that_are_not_the_store_s_are_passed_over(store, other):
    for name in ("records/../evil.json", "records/Toy/x.json", "objects/ab/notes", "objects/zz/" + "0" * 64):
        path = store.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    assert pull(other, remote_at(str(store.root))).artifacts == 3
    assert len([path for path in other.root.rglob("*.json") if path.parent.parent.name == "records"]) == 3
    assert not list(other.root.parent.glob("evil*"))


def test_pulled_circumstances_cannot_break_show(run, store, refs, other):
    path = store.record_path("total", refs["total"].key)
    data = json.loads(path.read_text())
    path.unlink()
    path.write_text(json.dumps({**data, "made": {"libraries": ["x"], "options": 3}}))
    assert pull(other, remote_at(str(store.root))).artifacts == 2
    assert run(other, "ls").exit_code == 0


def test_a_place_without_a_store_is_bad_input(run, store, place):
    for arguments in (("pull", place), ("push", place)):
        told = run(store, *arguments)
        assert told.exit_code == 3
        assert len(told.stderr.splitlines()) == 1


@pytest.mark.usefixtures("refs")
def test_an_unknown_kind_of_url_is_bad_input(run, store):
    told = run(store, "push", "nowhere://bucket")
    assert told.exit_code == 3
    assert "nowhere://" in told.stderr


@pytest.mark.usefixtures("refs")
def test_a_folder_needs_no_fsspec_and_a_url_says_so(run, store, other, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **more):
        if name.startswith("fsspec"):
            raise ImportError(name)
        return real(name, *arguments, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    assert run(store, "push", other.root).exit_code == 0
    told = run(store, "push", "memory://bucket")
    assert told.exit_code == 3
    assert "need the package fsspec" in told.stderr


@pytest.mark.usefixtures("refs")
def test_a_backend_that_is_not_installed_is_named(run, store, monkeypatch):
    def missing(_place):
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr("fsspec.core.url_to_fs", missing)
    told = run(store, "push", "s3://bucket/prefix")
    assert told.exit_code == 3
    assert (
        told.stderr == "s3://bucket/prefix: s3:// needs a package that is not installed (Install s3fs to access S3)\n"
    )
