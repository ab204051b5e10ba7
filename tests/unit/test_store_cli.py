"""`drl-meshgen store`: what an operator sees of the store, and what damage and tidying up do to it."""

import json
import multiprocessing
import os
import subprocess
import sys
from dataclasses import replace

import pytest

from drl_meshgen.commands.storing import bytes_of, size_text
from drl_meshgen.errors import InputError
from drl_meshgen.store import Recipe, Store, execute
from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.compare import flattened
from drl_meshgen.store.gc import gc
from drl_meshgen.store.locks import idle
from drl_meshgen.store.verify import Fault, verify
from tests.flow.toys import STAGES, DoubleOptions, NumberOptions

OLD = 10**18
"""A time (ns) before any process of today began."""


def aged(store, ages):
    """Set when artifacts were last asked for, in seconds after OLD."""
    for ref, age in ages.items():
        time = OLD + age * 10**9
        os.utime(store.record_path(ref.stage, ref.key), ns=(time, time))


def rewritten(path, change):
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(change(content))


def toy(store, n, content="x"):
    """Store an artifact whose content is the same for every `n`."""

    def compute(folder):
        (folder / "x").write_text(content)

    return store.run(Recipe.of("toy", 1, "0" * 64, {}, {"n": n}), compute)


DAMAGES = {
    "truncated": lambda content: content[:-1],
    "emptied": lambda _content: b"",
    "bit flipped": lambda content: content[:9] + bytes([content[9] ^ 1]) + content[10:],
    "of another kind": lambda _content: b"\xff\xfe null",
    "nested deeply": lambda _content: b"[" * 100_000,
}


# ls


def test_every_artifact_is_listed_with_the_surface_it_came_from(run, store, refs):
    execute(STAGES, {"number": NumberOptions("four")}, store=store)
    lines = run(store, "ls").stdout.splitlines()
    assert len(lines) == 6
    assert [line.split()[0] for line in lines] == ["double"] * 2 + ["number"] * 2 + ["total"] * 2
    assert sorted(line.split()[-1] for line in lines) == ["four"] * 3 + ["three"] * 3
    assert refs["total"].key[:12] in run(store, "ls").stdout


def test_lists_can_be_of_one_stage_or_one_surface_and_in_json(run, store, refs):
    execute(STAGES, {"number": NumberOptions("four")}, store=store)
    rows = json.loads(run(store, "ls", "--stage", "double", "--input", "three", "--json").stdout)
    assert [(row["stage"], row["key"], row["input"]) for row in rows] == [("double", refs["double"].key, ["three"])]
    assert rows[0]["size"] == 3
    assert run(store, "ls", "--stage", "ricci").exit_code == 3


# show


def test_an_artifact_tells_where_it_comes_from(run, store, refs):
    facts = json.loads(run(store, "show", refs["total"].key, "--json").stdout)
    assert facts["inputs"]["double"]["keys"] == [refs["double"].key]
    assert {one["stage"] for one in facts["made_from"]} == {"number", "double"}
    assert facts["outputs"] == {"value.json": {"sha256": refs["total"].outputs["value.json"], "size": 3}}
    assert facts["made"]["code"]
    assert facts["made"]["python"].startswith("3.")
    assert set(facts["timings"]) == {"seconds", "parts"}
    told = run(store, "show", refs["double"].key[:10])
    assert told.exit_code == 0
    assert "times = 1" in told.stdout
    assert refs["number"].key[:12] in told.stdout


def test_options_that_stay_out_of_the_key_are_told_too(run, store, refs):
    facts = json.loads(run(store, "show", refs["number"].key, "--json").stdout)
    assert facts["options"]["delay"] == 0.0
    assert "delay" not in facts["identity"]


def test_a_record_of_old_that_tells_of_no_versions_is_still_shown(run, store, refs):
    path = store.record_path("total", refs["total"].key)
    rewritten(path, lambda content: json.dumps({k: v for k, v in json.loads(content).items() if k != "made"}).encode())
    told = run(store, "show", refs["total"].key)
    assert told.exit_code == 0
    assert "libraries not recorded" in told.stdout


@pytest.mark.usefixtures("refs")
@pytest.mark.parametrize("key", ["zz", "", "../x", "0" * 64])
def test_an_unknown_id_is_bad_input(run, store, key):
    result = run(store, "show", key)
    assert result.exit_code == 3
    assert len(result.stderr.splitlines()) == 1


def test_an_ambiguous_prefix_is_bad_input(run, store):
    keys = [toy(store, n) for n in range(17)]
    first = [ref.key[0] for ref in keys]
    twice = next(digit for digit in first if first.count(digit) > 1)
    result = run(store, "show", twice)
    assert result.exit_code == 3
    assert "give more digits" in result.stderr


@pytest.mark.parametrize("command", [["ls"], ["show", "00"], ["verify"], ["gc"]])
def test_a_folder_that_is_no_store_is_bad_input(run, tmp_path, command):
    result = run(Store(tmp_path / "none"), *command)
    assert result.exit_code == 3
    assert "is no artifact store" in result.stderr
    assert not (tmp_path / "none").exists()


def test_an_input_made_in_two_ways_is_traced_to_both(store):
    one = execute(STAGES[:2], {"number": NumberOptions("three"), "double": DoubleOptions(0)}, store=store).refs
    two = execute(STAGES[:2], {"double": DoubleOptions(times=0, limit=9.0)}, store=store).refs
    assert one["double"].digest == two["double"].digest
    total = execute(STAGES, {"double": DoubleOptions(0)}, store=store).refs["total"]
    catalogue = Catalogue.of(store)
    assert len(catalogue.origins(catalogue.named(total.key))["double"]) == 2


# verify


@pytest.mark.usefixtures("refs")
def test_a_sound_store_is_found_sound(run, store):
    result = run(store, "verify")
    assert result.exit_code == 0
    assert "3 records and 3 objects are sound; 0 objects are unused" in result.stdout


@pytest.mark.parametrize("damage", [name for name in DAMAGES if name != "bit flipped"] + ["removed"])
def test_every_damage_to_an_object_is_found_and_repaired(run, store, refs, damage):
    path = store.objects.path(refs["double"].outputs["value.json"])
    if damage == "removed":
        path.unlink()
    else:
        rewritten(path, DAMAGES[damage])
    told = run(store, "verify")
    assert told.exit_code == 1
    assert path.exists() == (damage != "removed")
    assert f"records/double/{refs['double'].key}.json: record names an object" in told.stdout
    assert run(store, "verify", "--repair").exit_code == 1
    assert run(store, "verify").exit_code == 0
    assert execute(STAGES, store=store).refs == refs
    assert run(store, "verify").exit_code == 0


@pytest.mark.parametrize("bit", range(8))
def test_every_flipped_bit_of_an_object_is_found(store, refs, bit):
    path = store.objects.path(refs["double"].outputs["value.json"])
    rewritten(path, lambda content: content[:-1] + bytes([content[-1] ^ (1 << bit)]))
    assert {damage.fault for damage in verify(store).damages} == {Fault.OBJECT, Fault.UNSOUND}


@pytest.mark.parametrize("damage", list(DAMAGES))
def test_every_damage_to_a_record_is_found_and_repaired(run, store, refs, damage):
    path = store.record_path("double", refs["double"].key)
    if damage == "bit flipped":
        rewritten(path, lambda content: content.replace(b'"value.json"', b'"valud.json"'))
    else:
        rewritten(path, DAMAGES[damage])
    told = run(store, "verify")
    assert told.exit_code == 1
    assert told.stdout.splitlines()[0] == f"records/double/{path.name}: record is unreadable or altered"
    run(store, "verify", "--repair")
    assert not path.exists()
    assert execute(STAGES, store=store).refs == refs
    assert run(store, "verify").exit_code == 0


def test_a_removed_record_leaves_objects_that_nobody_names(store, refs):
    store.record_path("double", refs["double"].key).unlink()
    verdict = verify(store)
    assert (verdict.damages, verdict.records, verdict.unused) == ((), 2, 1)
    assert execute(STAGES, store=store).refs == refs
    assert verify(store).unused == 0


@pytest.mark.usefixtures("refs")
def test_files_that_are_not_the_store_s_are_told_and_left_alone(run, store):
    strange = [
        store.root / "objects/ab/notes.txt",
        store.root / "records/notes.json",
        store.root / "records/toy/x.json",
    ]
    for path in strange:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    assert run(store, "verify", "--repair").exit_code == 1
    assert all(path.exists() for path in strange)
    assert run(store, "ls").exit_code == 0


# gc


def test_gc_without_a_size_removes_rubbish_only(store, refs):
    stray = store.objects.path("ab" * 32)
    stray.parent.mkdir(exist_ok=True)
    stray.write_text("stray")
    (store.root / "tmp" / refs["total"].key / "outputs").mkdir(parents=True)
    (store.root / "tmp/used-by-nobody-1").mkdir()
    locks = len(list((store.root / "locks").iterdir()))
    dry = gc(store, dry_run=True)
    assert stray.exists()
    assert (dry.objects, dry.unfinished, dry.artifacts) == (1, 2, ())
    assert gc(store).freed == len("stray")
    assert not stray.exists()
    assert not list((store.root / "tmp").iterdir())
    assert len(list((store.root / "locks").iterdir())) <= locks - 3
    assert execute(STAGES, store=store).refs == refs


def test_gc_removes_what_was_unused_longest_until_the_size_is_met(store, refs):
    other = execute(STAGES, {"number": NumberOptions("four")}, store=store).refs
    aged(store, dict.fromkeys(other.values(), 1) | dict.fromkeys(refs.values(), 2))
    size = gc(store, dry_run=True).size
    cleaning = gc(store, max_size=size - 1)
    assert [record.ref for record in cleaning.artifacts] == [other["total"]]
    cleaning = gc(store, max_size=size * 6 // 10)
    assert [record.ref for record in cleaning.artifacts] == [other["double"], other["number"]]
    assert cleaning.size <= size * 6 // 10
    assert verify(store).damages == ()
    assert execute(STAGES, store=store).refs == refs


def test_gc_removes_nothing_before_what_was_made_from_it(store, refs):
    aged(store, {refs["number"]: 1, refs["double"]: 2, refs["total"]: 3})
    gone = gc(store, max_size=0).artifacts
    assert [record.ref.stage for record in gone] == ["total", "double", "number"]


def test_gc_keeps_an_artifact_and_all_it_was_made_from(run, store, refs):
    aged(store, dict.fromkeys(refs.values(), 1))
    assert run(store, "gc", "--keep", refs["double"].key[:16], "--max-size", "0").exit_code == 0
    left = {record.ref.stage for record in Catalogue.of(store).records}
    assert left == {"number", "double"}
    assert verify(store).damages == ()
    assert verify(store).unused == 0


def test_gc_keeps_content_that_another_artifact_shares(store):
    old, new = toy(store, 1), toy(store, 2)
    aged(store, {old: 1, new: 2})
    cleaning = gc(store, [Catalogue.of(store).named(new.key)], max_size=0)
    assert [record.ref for record in cleaning.artifacts] == [old]
    assert store.look_up("toy", new.key) == new


def test_gc_keeps_what_a_living_process_has_asked_for(store, refs):
    aged(store, dict.fromkeys(refs.values(), 1))
    store.find("double", refs["double"].key)
    cleaning = gc(store, max_size=0)
    assert [record.ref.stage for record in cleaning.artifacts] == ["total", "number"]
    assert cleaning.size == cleaning.kept > 0


def test_gc_in_a_dry_run_changes_nothing(run, store, refs):
    aged(store, dict.fromkeys(refs.values(), 1))
    before = sorted(str(path) for path in store.root.rglob("*"))
    told = run(store, "gc", "--max-size", "0", "--dry-run")
    assert "would remove 3 artifacts, 3 objects" in told.stdout
    assert sorted(str(path) for path in store.root.rglob("*")) == before


def test_gc_leaves_the_work_of_a_living_process_alone(store, refs):
    key = Recipe.of("toy", 1, "0" * 64, {}, {}).key

    def compute(folder):
        (folder / "x").write_text("x")
        with store.folder(refs["total"]) as reading:
            cleaning = gc(store)
            assert (reading / "value.json").exists()
        assert cleaning.unfinished == 0
        assert (store.root / "locks" / key).exists()

    ref = store.run(Recipe.of("toy", 1, "0" * 64, {}, {}), compute)
    assert store.look_up("toy", key) == ref


def test_a_process_counts_as_a_user_until_it_ends(store, refs):
    script = (
        "import sys; from drl_meshgen.store import Store; s = Store(sys.argv[1]); s.find('total', sys.argv[2]);"
        "print('ready', flush=True); sys.stdin.read(); import os; os._exit(1)"
    )
    arguments = [sys.executable, "-c", script, str(store.root), refs["total"].key]
    mine = set((store.root / "locks").glob("user-*"))
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as user:
        assert user.stdout.readline() == "ready\n"
        (lock,) = set((store.root / "locks").glob("user-*")) - mine
        with idle(lock) as free:
            assert not free
        user.communicate("")
    with idle(lock) as free:
        assert free
    gc(store)
    assert not lock.exists()


def _use(root, seed):
    """Run chains with ever other options, each read back to the end, as long as somebody else tidies up."""
    for turn in range(12):
        options = {"double": DoubleOptions(times=(seed + turn) % 4)}
        with_store = execute(STAGES, options, store=Store(root))
        if with_store["total"] != execute(STAGES, options)["total"]:
            raise ValueError("another result")


def test_gc_beside_running_processes_loses_nothing_they_use(store, refs):
    """What is not in use goes at every turn, though its content is that of things in use, and no run notices."""
    values = [str(value) for times in range(4) for value in (3.0, 3.0 * 2**times, 3.0 + 3.0 * 2**times)]
    aged(store, dict.fromkeys(refs.values(), 0))  # once: later it may be in use
    spawn = multiprocessing.get_context("spawn")
    users = [spawn.Process(target=_use, args=(store.root, seed)) for seed in range(2)]
    for user in users:
        user.start()
    turns = 0
    while any(user.is_alive() for user in users):
        unused = toy(store, turns, values[turns % len(values)])
        aged(store, {unused: 0})
        assert unused in [record.ref for record in gc(store, max_size=0).artifacts]
        turns += 1
    for user in users:
        user.join()
    assert [user.exitcode for user in users] == [0, 0]
    assert verify(store).damages == ()


@pytest.mark.usefixtures("refs")
def test_a_size_that_is_none_is_a_usage_error(run, store):
    assert run(store, "gc", "--max-size", "lots").exit_code == 2


@pytest.mark.parametrize(
    ("text", "size"), [("0", 0), ("12", 12), ("2kB", 2000), ("1.5 MB", 1_500_000), ("2GiB", 2**31), ("1t", 10**12)]
)
def test_sizes_are_read_as_people_write_them(text, size):
    assert bytes_of(text) == size


def test_sizes_are_shown_with_three_digits():
    assert [size_text(size) for size in (0, 999, 1234, 999_600, 12_345_678)] == [
        "0 B",
        "999 B",
        "1.23 kB",
        "1000 kB",
        "12.3 MB",
    ]


def test_records_that_go_round_in_a_circle_are_traced_to_an_end(store, refs):
    """Contents say what was made from what, and two stages may have undone each other."""
    double = replace(STAGES[1], inputs=("total",), name="number", run=lambda inputs, _o: inputs["total"] - 6.0)
    given = {"total": refs["total"]}
    recipe = double.recipe(given, DoubleOptions())
    store.run(recipe, lambda folder: double.write(3.0, folder))
    catalogue = Catalogue.of(store)
    lineage = catalogue.lineage([catalogue.named(refs["total"].key)])
    assert len(lineage) == 4
    assert gc(store, dry_run=True).artifacts == ()


def test_options_are_told_leaf_by_leaf():
    assert flattened({"a": {"b": 1}, "c": [], "d": [1, 2], "e": [{"f": 2}]}, "o") == {
        "o.a.b": 1,
        "o.c": [],
        "o.d": [1, 2],
        "o.e[0].f": 2,
    }


@pytest.mark.usefixtures("refs")
def test_an_empty_text_names_no_artifact(store):
    with pytest.raises(InputError, match="no artifact has a key"):
        Catalogue.of(store).named("")
