"""Copies artifacts between stores; what comes in is checked by its digest before anybody sees it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from drl_meshgen.errors import InputError
from drl_meshgen.store.canonical import file_digest
from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.locks import shared
from drl_meshgen.store.objects import settle
from drl_meshgen.store.record import LARGEST_RECORD, Record, parsed
from drl_meshgen.store.remote import Remote
from drl_meshgen.store.store import Store


@dataclass(frozen=True)
class Transfer:
    """What was copied."""

    artifacts: int
    """Records that were copied."""
    objects: int
    size: int
    """Bytes of these objects."""
    refused: tuple[str, ...]
    """A sentence per artifact that was not copied because it is damaged."""


def push(store: Store, remote: Remote, only: Sequence[Record] = ()) -> Transfer:
    """Copy the artifacts that the remote lacks; a file there of another size counts as lacking.

    Where `only` names any, these and all they were made from. Each is checked before it is sent, objects go before the
    record that names them. Raises `InputError` where there is no store and OSError where the remote fails.
    """
    catalogue, there = Catalogue.of(store), remote.sizes()
    wanted = catalogue.lineage(only) if only else catalogue.records
    artifacts = objects = size = 0
    refused = []
    for record in wanted:
        name = _record_name(record)
        files = {_object_name(sha): store.objects.path(sha) for sha in sorted(set(record.ref.outputs.values()))}
        lacking = [one for one, path in files.items() if not path.is_file() or there.get(one) != path.stat().st_size]
        if not lacking and not _record_lacking(store, record, remote, there):
            continue
        if store.find(record.ref.stage, record.ref.key) is None:
            refused.append(f"{name}: its files are damaged or missing here")
            continue
        with remote.at_work():
            for one in lacking:
                remote.send(files[one], one)
                there[one] = files[one].stat().st_size
                objects, size = objects + 1, size + there[one]
            if _record_lacking(store, record, remote, there):
                remote.send(store.root / name, name)
        artifacts += 1
    return Transfer(artifacts, objects, size, tuple(refused))


def pull(store: Store, remote: Remote, only: Sequence[str] = ()) -> Transfer:
    """Copy the artifacts that this store lacks, or whose record is damaged or names a file that is missing.

    Where `only` names any by the start of their keys, these and all they were made from; then all records of the remote
    are read first. Nothing becomes visible before its digest was checked, the record last. Raises `InputError` where
    the remote has no record or none of such a key, and OSError where it fails.
    """
    there = remote.sizes()
    names = sorted(name for name in there if name.startswith("records/"))
    if not names:
        raise InputError("pull", "there is no artifact store at that place", "name the folder that has records/ in it")
    if only:
        names = _lineage(store, remote, {name: there[name] for name in names}, only)
    artifacts = objects = size = 0
    refused = []
    for name in names:
        _, stage, file = name.split("/")
        if _complete(store, stage, file.removesuffix(".json")):
            continue
        with store.scratch() as folder:
            record = _fetched_record(remote, name, there[name], folder / "record.json")
            if record is None:
                refused.append(f"{name}: record is unreadable or altered")
                continue
            missing = [sha for sha in sorted(set(record.ref.outputs.values())) if not store.objects.intact(sha)]
            bad = next((sha for sha in missing if not _fetched(remote, there, sha, folder)), None)
            if bad is not None:
                refused.append(f"{name}: {_object_name(bad)} is missing or damaged there")
                continue
            with shared(store.guard):
                for sha in missing:
                    size += (folder / sha).stat().st_size
                    objects += 1
                    settle(folder / sha, store.objects.path(sha))
                settle(folder / "record.json", store.root / name)
        artifacts += 1
    return Transfer(artifacts, objects, size, tuple(refused))


def _lineage(store: Store, remote: Remote, sizes: Mapping[str, int], keys: Sequence[str]) -> list[str]:
    """Return the names of the remote's records of artifacts and of all they were made from."""
    with store.scratch() as folder:
        read = (_fetched_record(remote, name, size, folder / "record.json") for name, size in sizes.items())
        catalogue = Catalogue(record for record in read if record is not None)
    return [_record_name(record) for record in catalogue.lineage(catalogue.named(key) for key in keys)]


def _object_name(sha: str) -> str:
    return f"objects/{sha[:2]}/{sha}"


def _record_name(record: Record) -> str:
    return f"records/{record.ref.stage}/{record.ref.key}.json"


def _record_lacking(store: Store, record: Record, remote: Remote, there: Mapping[str, int]) -> bool:
    """Tell whether the remote has no sound record of the key; one that differs in times alone is as good as ours."""
    name = _record_name(record)
    if name not in there:
        return True
    if there[name] == (store.root / name).stat().st_size:
        return False
    with store.scratch() as folder:
        return _fetched_record(remote, name, there[name], folder / "record.json") is None


def _fetched_record(remote: Remote, name: str, size: int, target: Path) -> Record | None:
    if size > LARGEST_RECORD:
        return None
    remote.fetch(name, target)
    _, stage, file = name.split("/")
    return parsed(stage, file.removesuffix(".json"), target.read_bytes())


def _fetched(remote: Remote, there: Mapping[str, int], sha: str, folder: Path) -> bool:
    if _object_name(sha) not in there:
        return False
    remote.fetch(_object_name(sha), folder / sha)
    return file_digest(folder / sha) == sha


def _complete(store: Store, stage: str, key: str) -> bool:
    record = store.record(stage, key)
    return record is not None and all(store.objects.path(sha).is_file() for sha in record.ref.outputs.values())
