"""Damage of every object and every record of a run: what is damaged is computed again or refused, never served."""

import random
import shutil

import pytest

from drl_meshgen.pipeline import STAGES
from drl_meshgen.store import DamagedArtifactError, Store, execute
from drl_meshgen.store.verify import verify
from tests.faults.victim import OPTIONS

GIVEN = OPTIONS.by_stage("hemisphere", 5000)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return an undamaged store and what is in it."""
    store = Store(tmp_path_factory.mktemp("whole"))
    return store, execute(STAGES, GIVEN, store=store).refs


@pytest.fixture
def copy(whole, tmp_path):
    """Return a copy that can be damaged."""
    shutil.copytree(whole[0].root, tmp_path / "store")
    return Store(tmp_path / "store")


def flipped(content, seed):
    changed = bytearray(content)
    where = random.Random(seed).randrange(8 * len(changed))
    changed[where // 8] ^= 1 << (where % 8)
    return bytes(changed)


DAMAGES = {
    "emptied": lambda _content: b"",
    "cut to the first byte": lambda content: content[:1],
    "cut in half": lambda content: content[: len(content) // 2],
    "cut by the last byte": lambda content: content[:-1],
    "a byte longer": lambda content: content + b"\0",
    "a bit flipped": lambda content: flipped(content, 1),
    "another bit flipped": lambda content: flipped(content, 2),
    "zeroed": lambda content: bytes(len(content)),
    "a pickle": lambda _content: b"\x80\x04cos\nsystem\n(S'false'\ntR.",
    "deleted": lambda _content: None,
}


def damage(path, kind):
    content = DAMAGES[kind](path.read_bytes())
    path.unlink()
    if content is not None:
        path.write_bytes(content)


def test_no_damaged_object_is_ever_served(whole, copy):
    cases = 0
    for ref in whole[1].values():
        for sha in ref.outputs.values():
            path = copy.objects.path(sha)
            content = path.read_bytes()
            for kind in DAMAGES:
                damage(path, kind)
                assert copy.find(ref.stage, ref.key) is None, f"{ref.stage} {sha} {kind}"
                with pytest.raises(DamagedArtifactError), copy.folder(ref):
                    pass
                path.unlink(missing_ok=True)
                path.write_bytes(content)
                cases += 1
    assert cases == len(DAMAGES) * sum(len(ref.outputs) for ref in whole[1].values())
    assert verify(copy).damages == ()


def test_a_damaged_object_is_computed_again_by_its_stage_alone(whole, copy):
    for k, ref in enumerate(whole[1].values()):
        kind = list(DAMAGES)[k % len(DAMAGES)]
        damage(copy.objects.path(min(ref.outputs.values())), kind)
        done = execute(STAGES, GIVEN, store=copy)
        computed = [timing.stage for timing in done.timings if not timing.cached]
        assert done.refs == whole[1]
        # the first of the stages that have this content heals it for all
        assert len(computed) == 1, f"{ref.stage} {kind}"
        assert min(ref.outputs.values()) in whole[1][computed[0]].outputs.values()
        assert verify(copy).damages == ()


def test_no_damaged_record_is_ever_served(whole, copy):
    for ref in whole[1].values():
        path = copy.record_path(ref.stage, ref.key)
        content = path.read_bytes()
        kinds = {**DAMAGES, **{f"bit {seed}": lambda c, seed=seed: flipped(c, seed) for seed in range(3, 40)}}
        for kind, change in kinds.items():
            path.unlink(missing_ok=True)
            changed = change(content)
            if changed is not None:
                path.write_bytes(changed)
            # a bit of the seconds, which are outside the digest, changes nothing that is served
            assert copy.find(ref.stage, ref.key) in (None, ref), f"{ref.stage} {kind}"
        path.unlink(missing_ok=True)
        path.write_bytes(content)


def test_a_run_without_any_record_or_object_gives_the_same(whole, copy):
    shutil.rmtree(copy.root / "records")
    assert execute(STAGES, GIVEN, store=copy).refs == whole[1]
    shutil.rmtree(copy.root / "objects")
    assert execute(STAGES, GIVEN, store=copy).refs == whole[1]


@pytest.mark.parametrize("kind", ["folder", "link to another file", "link to itself", "link to nothing"])
def test_an_object_that_is_no_file_is_computed_again(whole, copy, kind):
    ref = whole[1]["partition"]
    path = copy.objects.path(next(iter(ref.outputs.values())))
    path.unlink()
    if kind == "folder":
        path.mkdir()
    else:
        target = {"link to another file": "/etc/hostname", "link to itself": path, "link to nothing": "nothing"}[kind]
        path.symlink_to(target)
    assert copy.find(ref.stage, ref.key) is None
    assert execute(STAGES, GIVEN, store=copy).refs == whole[1]
    assert verify(copy).damages == ()
