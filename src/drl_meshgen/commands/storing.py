"""The `store` commands: what is in the artifact store, where it came from, whether it is sound, and what may go."""

import json
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from drl_meshgen.commands.arguments import working
from drl_meshgen.errors import FINE, InputError
from drl_meshgen.store import Store
from drl_meshgen.store.catalogue import SHORT, Catalogue
from drl_meshgen.store.compare import flattened
from drl_meshgen.store.gc import gc
from drl_meshgen.store.record import Record
from drl_meshgen.store.remote import remote_at
from drl_meshgen.store.transfer import Transfer, pull, push
from drl_meshgen.store.verify import Fault, verify

if TYPE_CHECKING:
    from drl_meshgen.pipeline import MeshOptions
    from drl_meshgen.store.explain import Step

WRONG = 1

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def bytes_of(text: str) -> int:
    """Return the size that a text such as `500MB` or `2GiB` means, in bytes; raises ValueError for another text."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kmgt]i?)?b?", text.strip().lower())
    if match is None:
        raise ValueError(f"{text} is no size; write it like 500MB or 2GiB")
    return int(float(match[1]) * _UNITS[match[2] or ""])


def size_text(size: int) -> str:
    """Return a size for people, with three digits."""
    for unit, divisor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if size >= divisor:
            return f"{size / divisor:.3g} {unit}" if size < 999.5 * divisor else f"{size / divisor:.0f} {unit}"
    return f"{size} B"


def _catalogue(store: Store) -> Catalogue:
    with working("reading the records of the store"):
        return Catalogue.of(store)


def list_records(store: Store, stages: Sequence[str], inputs: Sequence[str], *, as_json: bool) -> int:
    """Print a line per record, or JSON; of these stages and surfaces where any are given."""
    catalogue = _catalogue(store)
    known = {record.ref.stage for record in catalogue.records}
    if unknown := [stage for stage in stages if stage not in known]:
        raise InputError(
            unknown[0], "no artifact is of such a stage", f"there are {', '.join(sorted(known)) or 'none'}"
        )
    chosen = [record for record in catalogue.records if not stages or record.ref.stage in stages]
    with working("looking up the files of the store"):
        rows = [_row(store, catalogue, record) for record in chosen]
    rows = [row for row in rows if not inputs or set(inputs) & set(row["input"])]
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return FINE
    for row in rows:
        size, surfaces = size_text(row["size"]), " ".join(row["input"])
        typer.echo(f"{row['stage']:<12} {row['key'][:SHORT]}  {size:>8}  {row['seconds']:8.2f} s  {surfaces}".rstrip())
    return FINE


def _row(store: Store, catalogue: Catalogue, record: Record) -> dict[str, Any]:
    asked = store.record_path(record.ref.stage, record.ref.key).stat().st_mtime
    return {
        "stage": record.ref.stage,
        "key": record.ref.key,
        "size": sum(_size(store, sha) or 0 for sha in set(record.ref.outputs.values())),
        "seconds": record.seconds,
        "input": catalogue.surfaces(record),
        "used": datetime.fromtimestamp(asked, UTC).isoformat(timespec="seconds"),
    }


def _size(store: Store, sha: str) -> int | None:
    path = store.objects.path(sha)
    return path.stat().st_size if path.is_file() else None


def show(store: Store, key: str, *, as_json: bool) -> int:
    """Print what is known of one artifact: what it was made from, with what, and what came of it."""
    catalogue = _catalogue(store)
    record = catalogue.named(key)
    facts = _facts(store, catalogue, record)
    typer.echo(json.dumps(facts, indent=1) if as_json else "\n".join(_told(facts)))
    return FINE


def _facts(store: Store, catalogue: Catalogue, record: Record) -> dict[str, Any]:
    origins = catalogue.origins(record)
    lineage = catalogue.lineage([record])
    given = [json.loads(one.made.get("options", "{}")) for one in lineage if not one.recipe.inputs]
    seeds = [options["seed"] for options in given if isinstance(options, dict) and "seed" in options]
    return {
        "stage": record.ref.stage,
        "key": record.ref.key,
        "version": record.recipe.version,
        "code": record.recipe.source,
        "made": {name: value for name, value in record.made.items() if name != "options"},
        "seed": seeds[0] if seeds else None,
        "options": json.loads(record.made.get("options", record.recipe.options)),
        "identity": json.loads(record.recipe.options),
        "inputs": {
            name: {"content": record.recipe.inputs[name], "keys": [one.ref.key for one in origins[name]]}
            for name in origins
        },
        "made_from": [
            {"stage": one.ref.stage, "key": one.ref.key, "input": catalogue.surfaces(one)} for one in lineage[1:]
        ],
        "outputs": {name: {"sha256": sha, "size": _size(store, sha)} for name, sha in record.ref.outputs.items()},
        "timings": {"seconds": record.seconds, "parts": dict(record.parts)},
    }


def _told(facts: dict[str, Any]) -> Iterable[str]:
    made = facts["made"]
    yield f"{facts['stage']} {facts['key']}"
    yield f"version   {facts['version']}"
    yield f"code      {facts['code']}" + (f" (drl-meshgen {made['code']})" if "code" in made else "")
    if made:
        yield f"machine   python {made.get('python', '?')}, {made.get('platform', '?')}"
        yield "libraries " + ", ".join(f"{name} {version}" for name, version in made.get("libraries", {}).items())
    else:
        yield "libraries not recorded; they are part of the digest of the code"
    yield "seed      " + ("not recorded" if facts["seed"] is None else str(facts["seed"]))
    yield "options"
    yield from _lines(facts["options"])
    if facts["identity"] != facts["options"]:
        yield "identity (what the key has for options)"
        yield from _lines(facts["identity"])
    yield "inputs" if facts["inputs"] else "inputs    none"
    for name, entry in facts["inputs"].items():
        keys = " or ".join(key[:SHORT] for key in entry["keys"]) or "no record of it here"
        yield f"  {name}: {keys} (content {entry['content'][:SHORT]})"
    if facts["made_from"]:
        yield "made from"
        for one in facts["made_from"]:
            yield f"  {one['stage']:<12} {one['key'][:SHORT]}  {' '.join(one['input'])}".rstrip()
    yield "outputs"
    for name, entry in facts["outputs"].items():
        size = "missing" if entry["size"] is None else size_text(entry["size"])
        yield f"  {name:<22} {size:>8}  {entry['sha256'][:SHORT]}"
    yield "timings"
    yield f"  {'all':<22} {facts['timings']['seconds']:8.3f} s"
    yield from (f"  {name:<22} {seconds:8.3f} s" for name, seconds in facts["timings"]["parts"].items())


def _lines(options: object) -> list[str]:
    leaves = {name.partition(".")[2]: leaf for name, leaf in flattened(options, "").items()}
    return [f"  {name} = {json.dumps(leaf)}" for name, leaf in leaves.items() if name.rpartition(".")[2] != "type"]


def check(store: Store, *, repair: bool) -> int:
    """Hash everything in the store and print what is damaged; the exit code is 1 where anything is."""
    with working("hashing all files of the store"):
        verdict = verify(store, repair=repair)
    for damage in verdict.damages:
        typer.echo(str(damage))
    count = len(verdict.damages)
    typer.echo(
        f"{verdict.records} records and {verdict.objects} objects are sound; {verdict.unused} objects are unused"
    )
    if not count:
        return FINE
    kept = sum(damage.fault is Fault.NAME for damage in verdict.damages)
    if repair:
        removed = f"{count - kept} removed, the next run computes them again"
        typer.echo(removed + (f"; {kept} of other names were left alone" if kept else ""), err=True)
    else:
        typer.echo(f"{count} damaged; --repair removes them, so that the next run computes them again", err=True)
    return WRONG


def clean_up(store: Store, keep: Sequence[str], max_size: int | None, *, dry_run: bool) -> int:
    """Remove rubbish and, above a size in bytes, artifacts; print what went and what is left."""
    catalogue = _catalogue(store)
    kept = [catalogue.named(key) for key in keep]
    with working("looking for what may go"):
        cleaning = gc(store, kept, max_size, dry_run=dry_run)
    for record in cleaning.artifacts:
        typer.echo(f"{record.ref.stage:<12} {record.ref.key[:SHORT]}  {' '.join(catalogue.surfaces(record))}".rstrip())
    typer.echo(
        f"{'would remove' if dry_run else 'removed'} {len(cleaning.artifacts)} artifacts, {cleaning.objects} objects, "
        f"{cleaning.unfinished} unfinished, {cleaning.locks} locks: {size_text(cleaning.freed)}; "
        f"{size_text(cleaning.size)} {'would be' if dry_run else 'are'} left"
    )
    if max_size is not None and cleaning.size > max_size:
        typer.echo(
            f"more than {size_text(max_size)} are left: {size_text(cleaning.kept)} are kept by name or in use", err=True
        )
    return FINE


def explain(
    store: Store, source: str, options: "MeshOptions", triangles: int, layout: Path | None, *, compare: bool = False
) -> int:
    """Print for every stage whether a run would find it in the store and, if not, what differs.

    With `compare` also for that of the rivals.
    """
    from drl_meshgen.commands.layout_file import steered
    from drl_meshgen.pipeline import COMPARED_STAGES, STAGES, coarsened
    from drl_meshgen.store.explain import Fate, plan

    if layout is not None:
        options = steered(options, layout, source, triangles)
    else:
        options = coarsened(options, source, triangles)
    stages = COMPARED_STAGES if compare else STAGES
    for step in plan(stages, options.by_stage(source, triangles, compare=compare), store):
        key = "" if step.key is None else step.key[:SHORT]
        typer.echo(f"{step.stage:<12} {key:<{SHORT}}  {step.fate.value}")
        if step.fate is Fate.CACHED:
            continue
        for line in _why(step):
            typer.echo(f"  {line}")
    return FINE


def _why(step: "Step") -> Iterable[str]:
    if step.nearest is None:
        yield "the store has nothing of this stage"
        return
    for one in step.differences:
        yield f"{one.field}: {_shown(one.former)} -> {_shown(one.present)}"
    if step.unknown:
        yield f"given by {', '.join(step.unknown)}, which would run before"
    elif not step.differences:
        yield "it was computed, but its files are damaged or missing"
    yield f"compared with {step.nearest.ref.key[:SHORT]}"


def _shown(value: object) -> str:
    if isinstance(value, str) and re.fullmatch(r"[0-9a-f]{64}", value):
        return value[:SHORT]
    return "nothing" if value is None else json.dumps(value)


def recompute(store: Store, key: str, source: Path | None, *, whole: bool = False) -> int:
    """Compute an artifact again and print whether it is the same, bit by bit; the exit code is 1 where it is not.

    With `whole` also everything it was made from, the surface first.
    """
    catalogue = _catalogue(store)
    named = catalogue.named(key)
    if not whole:
        return _again(catalogue, named, store, source)
    lineage = reversed(catalogue.lineage([named]))
    return max([_again(catalogue, one, store, None if one.recipe.inputs else source) for one in lineage])


def _again(catalogue: Catalogue, record: Record, store: Store, source: Path | None) -> int:
    typer.echo(f"{record.ref.stage} {record.ref.key[:SHORT]}: computing it again, which took {record.seconds:.2f} s")

    from drl_meshgen.commands import reports
    from drl_meshgen.pipeline import COMPARED_STAGES
    from drl_meshgen.store.reproduce import reproduce

    if record.ref.stage == reports.STAGE:
        done = reports.reproduce(catalogue, record, store)
    else:
        done = reproduce(COMPARED_STAGES, catalogue, record, store, source)
    for sentence in done.different:
        typer.echo(sentence)
    if done.code_changed:
        typer.echo("the code of the stage, or a library it uses, is not the one it was made with", err=True)
    if done.different:
        typer.echo(f"{len(done.different)} files differ, {len(done.same)} are the same", err=True)
        return WRONG
    typer.echo(f"the same: {len(done.same)} files, bit by bit")
    return FINE


def copy_out(store: Store, target: str, only: Sequence[str]) -> int:
    """Copy what a folder or a URL lacks; the exit code is 1 where something here is damaged and was not copied.

    `only` are keys of artifacts that are copied with all they were made from; none: everything.
    """
    catalogue = _catalogue(store)
    chosen = [catalogue.named(key) for key in only]
    with working(f"copying to {target}"):
        transfer = push(store, remote_at(target), chosen)
    return _copied(transfer, "sent")


def copy_in(store: Store, source: str, only: Sequence[str]) -> int:
    """Copy what this store lacks; the exit code is 1 where something there is damaged and was not copied.

    `only` are keys of artifacts there that are copied with all they were made from; none: everything.
    """
    with working(f"copying from {source}"):
        transfer = pull(store, remote_at(source), only)
    return _copied(transfer, "fetched")


def _copied(transfer: Transfer, done: str) -> int:
    for sentence in transfer.refused:
        typer.echo(sentence, err=True)
    typer.echo(f"{done} {transfer.artifacts} artifacts, {transfer.objects} objects, {size_text(transfer.size)}")
    return WRONG if transfer.refused else FINE
