"""Removes what is not wanted any more: rubbish always, artifacts by when they were last asked for."""

import shutil
from collections import Counter
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from drl_meshgen.store.catalogue import Catalogue, existing
from drl_meshgen.store.locks import USER, exclusive, idle
from drl_meshgen.store.record import Record
from drl_meshgen.store.store import USED_BY, Store


@dataclass(frozen=True)
class Cleaning:
    """What was removed, or would be."""

    artifacts: tuple[Record, ...]
    """In the order in which they went."""
    objects: int
    """Files of content, with those that no record named."""
    unfinished: int
    """Folders that dead processes left in `tmp`."""
    locks: int
    """Lock files that nobody holds."""
    freed: int
    """Bytes of objects and records."""
    size: int
    """Bytes of objects and records that are left."""
    kept: int
    """Bytes among them that had to stay: kept by name, or asked for by a process that is alive."""


@dataclass
class _Room:
    """Sizes of the files in a store, and how many records name each object."""

    records: dict[str, int]
    objects: dict[str, int]
    named: Counter[str]


def gc(store: Store, keep: Iterable[Record] = (), max_size: int | None = None, *, dry_run: bool = False) -> Cleaning:
    """Remove unnamed objects, what dead processes left, and, above `max_size` bytes, artifacts.

    Artifacts go by when they were last asked for, the oldest first, but none before what was made from it. `keep` and
    everything it was made from stay, and so does what was asked for since the longest-lived process that uses the
    store began to; None as size removes no artifact. Whoever looks something up waits meanwhile. With `dry_run`
    nothing is removed. Raises `InputError` where there is no store and OSError where a file cannot be removed.
    """
    existing(store)
    with exclusive(store.guard):
        began = _first_user(store)
        catalogue = Catalogue.of(store)
        used = {record.ref.key: _path(store, record).stat().st_mtime_ns for record in catalogue.records}
        kept = {record.ref.key for record in catalogue.lineage(keep)}
        if began is not None:
            kept |= {key for key, time in used.items() if time >= began}
        room = _measured(store, catalogue)
        size = sum(room.records.values()) + sum(room.objects.values())
        free = [sha for sha in room.objects if not room.named[sha]]
        left = size - sum(room.objects[sha] for sha in free)
        artifacts: list[Record] = []
        for record in _oldest_first(catalogue, used):
            if max_size is None or left <= max_size:
                break
            if record.ref.key in kept:
                continue
            artifacts.append(record)
            left -= room.records[record.ref.key]
            for sha in sorted(set(record.ref.outputs.values())):
                room.named[sha] -= 1
                if not room.named[sha] and sha in room.objects:
                    free.append(sha)
                    left -= room.objects[sha]
        if not dry_run:
            for record in artifacts:  # first, so that no record ever names an object that is gone
                _path(store, record).unlink(missing_ok=True)
            for sha in free:
                store.objects.path(sha).unlink(missing_ok=True)
        unfinished, locks = _left_over(store, dry_run=dry_run)
        stay = _size_of(room, [record for record in catalogue.records if record.ref.key in kept])
    return Cleaning(tuple(artifacts), len(free), unfinished, locks, size - left, left, stay)


def _path(store: Store, record: Record) -> Path:
    return store.record_path(record.ref.stage, record.ref.key)


def _first_user(store: Store) -> int | None:
    """Return when the longest-lived other process began to use the store (ns), None where there is none."""
    began = []
    for path in sorted((store.root / "locks").glob(f"{USER}*")):
        with idle(path) as free, suppress(FileNotFoundError):  # its process may end meanwhile
            if not free:
                began.append(path.stat().st_mtime_ns)
    return min(began, default=None)


def _measured(store: Store, catalogue: Catalogue) -> _Room:
    records = {record.ref.key: _path(store, record).stat().st_size for record in catalogue.records}
    objects = {path.name: path.stat().st_size for path in store.objects.files()}
    named = Counter(sha for record in catalogue.records for sha in set(record.ref.outputs.values()))
    return _Room(records, objects, named)


def _size_of(room: _Room, records: Collection[Record]) -> int:
    objects = {sha for record in records for sha in record.ref.outputs.values()}
    return sum(room.records[record.ref.key] for record in records) + sum(room.objects.get(sha, 0) for sha in objects)


def _oldest_first(catalogue: Catalogue, used: dict[str, int]) -> list[Record]:
    """Order artifacts by when they or what was made from them were last asked for; what was made comes first."""
    order = catalogue.lineage(catalogue.records)
    last = dict(used)
    for record in order:
        for found in catalogue.origins(record).values():
            for one in found:
                last[one.ref.key] = max(last[one.ref.key], last[record.ref.key])
    return sorted(order, key=lambda record: last[record.ref.key])  # stable: equal times keep the order of the lineage


def _left_over(store: Store, *, dry_run: bool) -> tuple[int, int]:
    """Remove folders and lock files of processes that are dead; return how many there were."""
    folders = locks = 0
    for folder in sorted((store.root / "tmp").glob("*")):
        owner = folder.name.removeprefix(USED_BY)
        name = folder.name if owner == folder.name else USER + owner.partition("-")[0]
        lock = store.root / "locks" / name
        with idle(lock) as free:
            if free or not lock.exists():
                folders += 1
                if not dry_run:
                    _remove(folder)
    for lock in sorted((store.root / "locks").glob("*")):
        if lock != store.guard:
            with idle(lock) as free:
                locks += free
                if free and not dry_run:
                    lock.unlink()
    return folders, locks


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)  # its owner may have finished meanwhile
