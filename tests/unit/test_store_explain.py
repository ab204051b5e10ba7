"""What a run would do and why, and artifacts computed a second time."""

import json
from dataclasses import fields, replace

import pytest

from drl_meshgen.decompose import DecomposeOptions
from drl_meshgen.decompose.zones import Zone
from drl_meshgen.errors import InputError
from drl_meshgen.export import write_surface_ply
from drl_meshgen.pipeline import STAGES as PIPELINE
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.store import Store, execute
from drl_meshgen.store.canonical import canonical
from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.explain import Fate, plan
from drl_meshgen.store.reproduce import reproduce
from drl_meshgen.store.restore import restored
from tests.flow.toys import DOUBLE, STAGES, DoubleOptions, NumberOptions
from tests.strategies import flat_disk


@pytest.fixture
def disk(tmp_path):
    path = tmp_path / "disk.ply"
    write_surface_ply(path, flat_disk(300))
    return path


@pytest.fixture
def cleaned(store, disk):
    """Artifacts of the first two stages of the pipeline."""
    return execute(PIPELINE, MeshOptions().by_stage(str(disk)), targets=["cleanup"], store=store).refs


# plan


def test_a_plan_of_what_was_run_finds_everything(store, refs):
    steps = plan(STAGES, {}, store)
    assert [(step.fate, step.key) for step in steps] == [(Fate.CACHED, refs[step.stage].key) for step in steps]


def test_a_plan_names_the_field_that_changed(store, refs):
    number, double, total = plan(STAGES, {"double": DoubleOptions(times=4)}, store)
    assert number.fate is Fate.CACHED
    assert double.fate is Fate.RUN
    assert [(one.field, one.former, one.present) for one in double.differences] == [("options.times", 1, 4)]
    assert double.nearest.ref == refs["double"]
    assert (total.fate, total.unknown, total.key) == (Fate.OPEN, ("double",), None)


def test_a_plan_compares_with_the_most_similar_record(store, refs):
    execute(STAGES, {"double": DoubleOptions(times=2, limit=9.0)}, store=store)
    step = plan(STAGES, {"double": DoubleOptions(times=3, limit=9.0)}, store)[1]
    assert [(one.field, one.former, one.present) for one in step.differences] == [("options.times", 2, 3)]
    step = plan(STAGES, {"double": DoubleOptions(times=1, limit=8.0)}, store)[1]
    assert step.nearest.ref == refs["double"]


@pytest.mark.usefixtures("refs")
def test_a_plan_tells_changed_code_and_changed_content(store):
    def write(result, folder):
        (folder / "value.json").write_text(json.dumps(result))

    stages = (STAGES[0], replace(DOUBLE, write=write), STAGES[2])
    assert [one.field for one in plan(stages, {}, store)[1].differences] == ["source"]
    execute(STAGES[:1], {"number": NumberOptions("four")}, store=store)
    step = plan(STAGES, {"number": NumberOptions("four")}, store)[1]
    assert [one.field for one in step.differences] == ["inputs.number"]


def test_a_plan_tells_of_damage(store, refs):
    store.objects.path(refs["double"].outputs["value.json"]).unlink()
    step = plan(STAGES, {}, store)[1]
    assert (step.fate, step.differences, step.key) == (Fate.RUN, (), refs["double"].key)


@pytest.mark.usefixtures("refs")
def test_a_plan_leaves_no_trace(store):
    before = {path: path.stat().st_mtime_ns for path in store.root.rglob("*")}
    plan(STAGES, {"double": DoubleOptions(times=4)}, store)
    assert {path: path.stat().st_mtime_ns for path in store.root.rglob("*")} == before


@pytest.mark.usefixtures("cleaned")
def test_the_plan_of_a_file_says_what_a_run_would_do(run, store, disk):
    told = run(store, "plan", disk, "--target-quads", 100)
    assert told.exit_code == 0
    lines = told.stdout.splitlines()
    assert lines[0] == "disk.ply: what a run would do"
    assert [line.split()[2] for line in lines[1:3]] == ["cached", "cached"]
    assert "the store has nothing of this stage" in told.stdout
    changed = run(store, "plan", disk, "--strict").stdout
    assert "  options.strict: false -> true" in changed.splitlines()
    moved = disk.rename(disk.with_name("other.ply"))
    assert '  options.name: "disk.ply" -> "other.ply"' in run(store, "plan", moved).stdout.splitlines()


@pytest.mark.usefixtures("cleaned")
def test_a_plan_takes_what_mesh_takes(run, store, disk):
    def stages(*options):
        told = run(store, "plan", disk, "--target-quads", 100, *options)
        return [line.split()[0] for line in told.stdout.splitlines()[1:] if not line.startswith(" ")]

    assert stages("--compare") == [*stages(), "comparison"]
    limited = run(store, "plan", disk, "--target-quads", 100, "--blocks", 40, "--max-irregular", 40)
    assert limited.exit_code == 0
    assert run(store, "plan", disk, "--target-quads", 100, "--seed", 8).exit_code == 0


@pytest.mark.usefixtures("cleaned")
def test_plans_of_nothing_are_bad_input(run, store, tmp_path):
    assert run(store, "plan", tmp_path / "none.stl").exit_code == 3
    assert run(Store(tmp_path / "none"), "plan", "hemisphere").exit_code == 3


# reproduce


def test_an_artifact_is_computed_again_from_its_record_alone(run, store, cleaned):
    for ref in cleaned.values():
        told = run(store, "reproduce", ref.key)
        assert told.exit_code == 0, told.output
        assert "the same: 2 files, bit by bit" in told.stdout


def test_an_artifact_is_computed_again_with_all_it_was_made_from(run, store, cleaned, disk):
    (disk.parent / "moved").mkdir()
    moved = disk.rename(disk.parent / "moved" / disk.name)
    told = run(store, "reproduce", cleaned["cleanup"].key, "--all", "--input", moved)
    assert told.exit_code == 0, told.output
    stages = [line.split()[0] for line in told.stdout.splitlines()[::2]]
    assert stages == ["model", "cleanup"]
    assert told.stdout.count("bit by bit") == 2


def test_a_moved_surface_is_named_and_another_one_refused(run, store, cleaned, disk):
    key = cleaned["model"].key
    (disk.parent / "moved").mkdir()
    moved = disk.rename(disk.parent / "moved" / disk.name)
    assert run(store, "reproduce", key).exit_code == 3
    assert run(store, "reproduce", key, "--input", moved).exit_code == 0
    write_surface_ply(moved, flat_disk(200))
    told = run(store, "reproduce", key, "--input", moved)
    assert told.exit_code == 3
    assert "another content" in told.stderr


def again(store, ref, stages=STAGES):
    catalogue = Catalogue.of(store)
    return reproduce(stages, catalogue, catalogue.named(ref.key), store)


def test_a_result_that_differs_is_told_with_its_place(store, refs):
    def other(inputs, _options):
        return inputs["number"] * 2 + 0.25

    done = again(store, refs["double"], (STAGES[0], replace(DOUBLE, run=other), STAGES[2]))
    assert done.same == ()
    assert done.different == ("value.json differs from byte 2 on, 3 bytes then, 4 now",)
    assert done.code_changed
    assert store.look_up("double", refs["double"].key) == refs["double"]


def test_options_outside_the_key_are_restored_too(store):
    refs = execute(STAGES, {"number": NumberOptions("four", delay=0.01)}, store=store).refs
    assert again(store, refs["number"]).same == ("value.json",)


def test_an_input_that_is_gone_is_bad_input(store, refs):
    store.record_path("number", refs["number"].key).unlink()
    with pytest.raises(InputError, match="its input number is not in the store any more"):
        again(store, refs["double"])


def test_a_stage_of_another_pipeline_is_bad_input(run, store, refs):
    told = run(store, "reproduce", refs["double"].key)
    assert told.exit_code == 3
    assert "no stage of the pipeline" in told.stderr


# options


@pytest.mark.parametrize("name", [field.name for field in fields(MeshOptions) if field.name != "seed"])
def test_options_of_every_stage_come_back_from_their_canonical_text(name):
    zones = (Zone("wanted", (0.0, 1.0, 2.5), radius=1.0),)
    decompose = DecomposeOptions(fixed=(("limb1", 8),), zones=zones)
    for options in (MeshOptions(), MeshOptions().fast(), replace(MeshOptions(), decompose=decompose)):
        own = getattr(options, name)
        assert restored(type(own), json.loads(canonical(own))) == own


@pytest.mark.parametrize("text", ['{"type":"Other"}', '{"type":"DoubleOptions","new":1}', "[]", "3", "null"])
def test_options_of_another_version_are_refused(text):
    with pytest.raises((ValueError, KeyError, TypeError)):
        restored(DoubleOptions, json.loads(text))
