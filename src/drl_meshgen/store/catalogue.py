"""All records of a store at one moment: found by the start of a key, and followed back to the surface."""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

from drl_meshgen.errors import InputError
from drl_meshgen.store.record import Record
from drl_meshgen.store.ref import checked_digest, checked_stage
from drl_meshgen.store.store import Store

SHORT = 12
"""Digits of a key that are shown in lists."""


def existing(store: Store) -> Store:
    """Return a store unchanged; raises `InputError` where its folder is none."""
    if not (store.root / "records").is_dir():
        raise InputError(str(store.root), "is no artifact store", "name one with --store or DRL_MESHGEN_STORE")
    return store


def record_names(store: Store) -> Iterator[tuple[str, str]]:
    """Yield stage and key of every file that is named like a record, in order."""
    for path in sorted((store.root / "records").glob("*/*.json")):
        try:
            yield checked_stage(path.parent.name), checked_digest(path.stem)
        except ValueError:
            continue


def upstream_stage(name: str) -> str:
    """Return the stage that an input of a recipe comes from; reports name theirs `model/stage`."""
    return name.rpartition("/")[2]


def options_of(record: Record) -> Mapping[str, Any]:
    """Return the options in a record's recipe by name."""
    options = json.loads(record.recipe.options)
    return options if isinstance(options, dict) else {"options": options}


class Catalogue:
    """Sound records by stage and key."""

    def __init__(self, records: Iterable[Record]) -> None:
        self.records = tuple(sorted(records, key=lambda record: (record.ref.stage, record.ref.key)))

    @classmethod
    def of(cls, store: Store) -> "Catalogue":
        """Read all records of a store; damaged ones are left out. Raises `InputError` where there is no store."""
        found = (store.record(stage, key) for stage, key in record_names(existing(store)))
        return cls(record for record in found if record is not None)

    @cached_property
    def _by_content(self) -> dict[tuple[str, str], list[Record]]:
        found = defaultdict(list)
        for record in self.records:
            found[record.ref.stage, record.ref.digest].append(record)
        return found

    def named(self, text: str) -> Record:
        """Return the record whose key starts with `text`; raises `InputError` where there is none or several."""
        found = [record for record in self.records if text and record.ref.key.startswith(text.lower())]
        if not found:
            raise InputError(text, "no artifact has a key that starts so", "`drl-meshgen store ls` lists them")
        if len(found) > 1:
            keys = ", ".join(f"{record.ref.stage} {record.ref.key[:SHORT]}" for record in found[:3])
            raise InputError(text, f"{len(found)} artifacts have keys that start so ({keys})", "give more digits")
        return found[0]

    def origins(self, record: Record) -> dict[str, tuple[Record, ...]]:
        """Return the records of each input, by its name: those with the content that went in.

        Several where one content was made in several ways; none where the records are gone.
        """
        inputs = record.recipe.inputs
        return {name: tuple(self._by_content.get((upstream_stage(name), inputs[name]), ())) for name in sorted(inputs)}

    def lineage(self, records: Iterable[Record]) -> tuple[Record, ...]:
        """Return the records and all they were made from, each once: what was made comes before what it is made from.

        Where one content was made in several ways, all of them.
        """
        opened: set[str] = set()
        done: list[Record] = []
        pending = [(record, False) for record in reversed(list(records))]
        while pending:
            record, finished = pending.pop()
            if finished:
                done.append(record)
            elif record.ref.key not in opened:
                opened.add(record.ref.key)
                pending.append((record, True))
                pending += [(one, False) for found in self.origins(record).values() for one in found]
        return tuple(reversed(done))

    def surfaces(self, record: Record) -> tuple[str, ...]:
        """Return the names of the surfaces that an artifact was made from, in alphabetical order."""
        roots = [one for one in self.lineage([record]) if not one.recipe.inputs]
        return tuple(sorted({surface_name(one) for one in roots}))


def surface_name(record: Record) -> str:
    """Return what the artifact of a first stage was read or built from; empty where its options name nothing."""
    options = options_of(record)
    return str(options.get("name") or options.get("source") or "")
