"""Looks at everything in a store, and says what is damaged."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from drl_meshgen.store.catalogue import existing
from drl_meshgen.store.locks import exclusive, shared
from drl_meshgen.store.ref import checked_digest
from drl_meshgen.store.store import Store


class Fault(Enum):
    """What can be wrong with a file of a store."""

    RECORD = "record is unreadable or altered"
    NAME = "file is not named as the store names files"
    OBJECT = "content is not what the name promises"
    MISSING = "record names an object that is missing"
    UNSOUND = "record names an object that is damaged"


@dataclass(frozen=True)
class Damage:
    """One thing that is wrong."""

    fault: Fault
    path: str
    """Place below the store's folder, with `/`."""
    detail: str = ""

    def __str__(self) -> str:
        """Return one line."""
        return f"{self.path}: {self.fault.value}" + (f" ({self.detail})" if self.detail else "")


@dataclass(frozen=True)
class Verdict:
    """What `verify` found."""

    damages: tuple[Damage, ...]
    records: int
    """Sound ones."""
    objects: int
    """Sound ones."""
    unused: int
    """Sound objects that no sound record names; `gc` removes them."""


def verify(store: Store, *, repair: bool = False) -> Verdict:
    """Read everything again and compare it with its digest.

    With `repair` damaged objects and records are removed, and records that name such objects, so that the next run
    computes them anew. Files of other names are left alone. Raises `InputError` where there is
    no store and OSError where a file cannot be read or removed.
    """
    with shared(existing(store).guard):
        verdict = _verified(store)
    if repair:
        with exclusive(store.guard):
            for damage in verdict.damages:
                path = store.root / damage.path
                if damage.fault is not Fault.NAME and not _sound(store, path):
                    path.unlink(missing_ok=True)
    return verdict


def _sound(store: Store, path: Path) -> bool:
    """Look again: somebody may have healed it meanwhile."""
    if path.suffix:
        return store.look_up(path.parent.name, path.stem) is not None
    return store.objects.intact(path.name)


def _verified(store: Store) -> Verdict:
    damages: list[Damage] = []
    sound: set[str] = set()
    for path in _files(store.root / "objects"):
        name = path.relative_to(store.root).as_posix()
        if not _named(path, "", path.name[:2]):
            damages.append(Damage(Fault.NAME, name))
        elif store.objects.intact(path.name):
            sound.add(path.name)
        else:
            damages.append(Damage(Fault.OBJECT, name, f"{path.lstat().st_size} bytes"))
    broken = {damage.path.rpartition("/")[2] for damage in damages}
    records, used = 0, set()
    for path in _files(store.root / "records"):
        name = path.relative_to(store.root).as_posix()
        if path.parent.parent != store.root / "records" or not _named(path, ".json", path.parent.name):
            damages.append(Damage(Fault.NAME, name))
            continue
        record = store.record(path.parent.name, path.stem)
        if record is None:
            damages.append(Damage(Fault.RECORD, name))
            continue
        lost = sorted(
            output for output, sha in record.ref.outputs.items() if sha not in sound and not store.objects.intact(sha)
        )
        if lost:
            there = any(record.ref.outputs[output] in broken for output in lost)
            damages.append(Damage(Fault.UNSOUND if there else Fault.MISSING, name, ", ".join(lost)))
        else:
            records += 1
        used.update(record.ref.outputs.values())
    return Verdict(tuple(damages), records, len(sound), len(sound - used))


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if not path.is_dir())


def _named(path: Path, suffix: str, folder: str) -> bool:
    try:
        checked_digest(path.name.removesuffix(suffix))
    except ValueError:
        return False
    return path.name.endswith(suffix) and path.parent.name == folder
