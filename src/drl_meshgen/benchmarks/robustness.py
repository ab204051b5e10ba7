"""Every real surface and 300 random ones through the pipeline: `python -m drl_meshgen.benchmarks.robustness --help`."""

import argparse
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import pandas as pd
import typer

from drl_meshgen.benchmarks.columns import FIGURES
from drl_meshgen.benchmarks.examine import FACTS, Case, Status, examine, failure, row
from drl_meshgen.benchmarks.pool import Ended, PoolOptions, run_jobs
from drl_meshgen.benchmarks.record import Record, Row
from drl_meshgen.benchmarks.summary import write_summary
from drl_meshgen.benchmarks.tables import write_both
from drl_meshgen.models.random_surface import PREFIX
from drl_meshgen.store.canonical import digest, file_digest
from drl_meshgen.store.source import source_digest

KINDS = ("single", "multi", "closed")
TARGETS = (2_000, 8_000, 30_000)
MESHES = "meshes"
"""Folder beside the rows measured so far that keeps the meshes."""
RANDOM, RANDOM_TARGET = "random", 2_000
HEAD = ("surface", "kind", "seed", "remesh", "target")
COLUMNS = (*HEAD, "status", "sentence", *FACTS, *FIGURES)


def file_cases(models: Path, kinds: Iterable[str], targets: Sequence[int], limit: int | None) -> list[Case]:
    """Return the cases of all files in the folders of these kinds: small counts first, raw before remeshed."""
    files = [(kind, path) for kind in kinds for path in sorted((models / kind).glob("*.*"))[:limit]]
    return [
        Case(kind, path.stem, str(path), None, remesh, target)
        for target in targets
        for remesh in (False, True)
        for kind, path in files
    ]


def random_cases(seeds: range) -> list[Case]:
    """Return the cases of the random surfaces."""
    return [Case(RANDOM, f"random-{n}", f"{PREFIX}{n}", n, remesh=False, target=RANDOM_TARGET) for n in seeds]


def measured(cases: Sequence[Case], record: Record, options: PoolOptions, referee: Path | None) -> None:
    """Examine the cases that are not in the record yet, and tell about each; meshes are kept beside the record."""
    left = [case for case in cases if case.key not in record.rows]
    typer.echo(f"{len(cases)} cases, {len(cases) - len(left)} of them measured before")
    for n, ended in enumerate(
        run_jobs(partial(examine, referee=referee, keep=record.path.with_name(MESHES)), left, options), 1
    ):
        case = left[ended.index]
        found = ended.result or row(case, {}, _unfinished(ended))
        record.add(case.key, found | {"seconds": ended.seconds})
        end = f"{found['status']} {found['sentence']} ({ended.seconds:.1f} s)"
        typer.echo(f"[{n}/{len(left)}] {case.key}: {end}")


def _unfinished(ended: Ended[Row]) -> Row:
    return failure(Status.OUT_OF_TIME if ended.timed_out else Status.DIED, ended.cause)


def write_tables(folder: Path, cases: Sequence[Case], record: Record) -> None:
    """Write `robustness.{parquet,csv}`, the times apart, as they differ from run to run, and the summary."""
    rows = [record.rows[case.key] for case in cases if case.key in record.rows]
    table = pd.DataFrame(rows, columns=[*COLUMNS, "seconds"])
    table = table.astype(dict.fromkeys(("seed", "genus", "loops", "components", "limbs"), "Int64"))
    table["seconds"] = table["seconds"].round(2)
    write_both(folder / "robustness", table.drop(columns="seconds"))
    write_both(folder / "robustness-seconds", table.reindex(columns=[*HEAD, "seconds"]))
    write_summary(folder)


def _seeds(text: str) -> range:
    first, _, end = text.partition(":")
    return range(int(first), int(end or int(first) + 1))


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where every surface went through, else 1."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.benchmarks.robustness", description=__doc__)
    parser.add_argument("--models", type=Path, default=Path("../shared/models"), help="folder of single, multi, closed")
    parser.add_argument("--referee", type=Path, help="independent checker: SCRIPT MESH --surface S --json")
    parser.add_argument("--only", nargs="+", choices=(*KINDS, RANDOM), default=(*KINDS, RANDOM))
    parser.add_argument("--targets", nargs="+", type=int, default=TARGETS, metavar="N", help="wanted quads of files")
    parser.add_argument("--limit", type=int, metavar="N", help="only the first N files of each kind")
    parser.add_argument("--seeds", type=_seeds, default=range(300), metavar="A:B", help="random surfaces A to B - 1")
    parser.add_argument("--out", type=Path, default=Path("out/robustness"), help="folder of the tables")
    parser.add_argument("--work", type=Path, default=Path("out/robustness"), help="folder of the rows measured so far")
    parser.add_argument("--resume", action="store_true", help="keep what an earlier run of the same code measured")
    parser.add_argument("--workers", type=int, default=PoolOptions.workers, metavar="N", help="processes; 0: cores")
    parser.add_argument("--timeout", type=float, default=PoolOptions.timeout, metavar="S", help="seconds per surface")
    parser.add_argument("--memory", type=float, default=PoolOptions.memory, metavar="G", help="GiB per process")
    given = parser.parse_args(arguments)
    kinds = [kind for kind in KINDS if kind in given.only]
    cases = file_cases(given.models, kinds, given.targets, given.limit)
    if kinds and not cases:
        parser.error(f"no surfaces in {given.models}; say where they are, or take --only random")
    cases += random_cases(given.seeds) if RANDOM in given.only else []
    referee = file_digest(given.referee) if given.referee else ""
    code = digest({"source": source_digest(("drl_meshgen.benchmarks.examine",)), "referee": referee})
    record = Record(given.work / "robustness.jsonl", code, resume=given.resume)
    try:
        measured(cases, record, PoolOptions(given.workers, given.timeout, given.memory), given.referee)
    finally:
        write_tables(given.out, cases, record)
    return int(any(record.rows[case.key]["status"] != Status.MESHED.value for case in cases))


if __name__ == "__main__":
    raise SystemExit(main())
