"""Ours against the rivals, same surface and matched count: `python -m drl_meshgen.benchmarks.quality --help`."""

import argparse
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pandas as pd
import typer

from drl_meshgen.baselines import Comparison, Method, RivalOptions, compare
from drl_meshgen.benchmarks.columns import FIGURES
from drl_meshgen.benchmarks.pool import PoolOptions, run_jobs
from drl_meshgen.benchmarks.record import Record, Row
from drl_meshgen.benchmarks.standings import PRINTED, write_standings
from drl_meshgen.benchmarks.tables import records, write_both
from drl_meshgen.cleanup import clean
from drl_meshgen.errors import MeshgenError
from drl_meshgen.models import MODELS, load
from drl_meshgen.pipeline import MeshOptions, run
from drl_meshgen.quality import quality_row
from drl_meshgen.report.inputs import OURS
from drl_meshgen.store.source import source_digest

MODEL_TARGETS, FILE_TARGETS = (2_000, 8_000), (4_000,)
RIVALS = (Method.QUASI_STRUCTURED, Method.QUADRIFLOW)
HEAD = ("surface", "target", "method", "ran", "ok", "cause", "defects")


@dataclass(frozen=True)
class Match:
    """A surface and how many quads everybody is to make of it."""

    surface: str
    """Name in the table."""
    source: str
    """Path or model name."""
    target: int
    """Wanted number of our quads; the rivals are asked for as many as ours turn out to be."""

    @property
    def key(self) -> str:
        """Name of the match, unlike that of any other."""
        return f"{self.surface} {self.target}"


def matches(models: Path, wanted: Sequence[str], targets: Sequence[int] | None) -> list[Match]:
    """Return a match per generated model and count, then per file of `single`; `wanted` names the surfaces, or all."""
    found = [Match(name, name, n) for name in MODELS for n in targets or MODEL_TARGETS]
    files = sorted((models / "single").glob("*.*"))
    found += [Match(path.stem, str(path), n) for path in files for n in targets or FILE_TARGETS]
    return [match for match in found if not wanted or match.surface in wanted]


def play(match: Match, options: RivalOptions) -> list[Row]:
    """Mesh one surface by every method; one row each. What fails is a row with its cause, ours too."""
    wanted = replace(MeshOptions().sized(match.target), comparison=options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            done = run(match.source, wanted, compare=True)
        except MeshgenError as error:
            return _rows(match, quality_row(OURS, None, ok=False, cause=str(error)), _without_ours(match, options))
    rivals: Comparison = done["comparison"]
    timings = {timing.stage: timing for timing in done.timings}
    rivals = replace(rivals, seconds=timings["comparison"].parts)
    seconds = sum(timing.seconds for stage, timing in timings.items() if stage not in ("comparison", "quality"))
    return _rows(match, quality_row(OURS, done["quality"], seconds), rivals)


def _without_ours(match: Match, options: RivalOptions) -> Comparison:
    try:
        return compare(clean(load(match.source)).surface, match.target, options)
    except MeshgenError:
        return Comparison.none()


def _rows(match: Match, ours: Row, rivals: Comparison) -> list[Row]:
    """Return the rows in the columns of the table; times of the rivals are those inside the mesher."""
    theirs = [row | {"seconds": rivals.seconds.get(str(row["method"]), math.nan)} for row in records(rivals.rows)]
    head = {"surface": match.surface, "target": match.target, "ran": True}
    return [
        {name: (head | row).get(name, math.nan) for name in (*HEAD, *FIGURES, "seconds")} for row in (ours, *theirs)
    ]


def table_of(wanted: Sequence[Match], record: Record) -> pd.DataFrame:
    """Return all rows in the order of the matches, after each match the printed rows of rivals not run here."""
    rows: list[Row] = []
    for match in wanted:
        rows += record.rows.get(match.key, {}).get("rows", [])
        rows += [
            row | {"ran": False} for row in PRINTED if (row["surface"], row["target"]) == (match.surface, match.target)
        ]
    return pd.DataFrame(rows, columns=[*HEAD, *FIGURES, "seconds"])


def write_tables(folder: Path, wanted: Sequence[Match], record: Record) -> None:
    """Write `quality.{parquet,csv}`, the times apart, as they differ from run to run, and the standings."""
    table = table_of(wanted, record)
    write_both(folder / "quality", table.drop(columns="seconds"))
    timed = table.reindex(columns=["surface", "target", "method", "seconds"]).dropna()
    write_both(folder / "quality-seconds", timed.assign(seconds=timed["seconds"].round(2)))
    write_standings(folder)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 1 where ours made no mesh of a surface, else 0."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.benchmarks.quality", description=__doc__)
    parser.add_argument("--models", type=Path, default=Path("../shared/models"), help="folder that has single")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="surfaces by name")
    parser.add_argument("--targets", nargs="+", type=int, metavar="N", help="wanted quads, instead of the usual ones")
    parser.add_argument("--out", type=Path, default=Path("out/quality"), help="folder of the tables")
    parser.add_argument("--work", type=Path, default=Path("out/quality"), help="folder of the rows measured so far")
    parser.add_argument("--resume", action="store_true", help="keep what an earlier run of the same code measured")
    parser.add_argument("--workers", type=int, default=PoolOptions.workers, metavar="N", help="processes; 0: cores")
    parser.add_argument("--rival-timeout", type=float, default=120.0, metavar="S", help="seconds per rival and surface")
    given = parser.parse_args(arguments)
    wanted = matches(given.models, given.only, given.targets)
    options = RivalOptions(tuple(method.key for method in RIVALS), given.rival_timeout, corrections=4)
    record = Record(given.work / "quality.jsonl", source_digest(("drl_meshgen.pipeline",)), resume=given.resume)
    left = [match for match in wanted if match.key not in record.rows]
    typer.echo(f"{len(wanted)} matches, {len(wanted) - len(left)} of them played before")
    limit = PoolOptions(given.workers, timeout=300 + given.rival_timeout * len(RIVALS))
    try:
        for n, ended in enumerate(run_jobs(partial(play, options=options), left, limit), 1):
            match = left[ended.index]
            lost = quality_row(OURS, None, ok=False, cause=ended.cause)
            rows = ended.result or _rows(match, lost, Comparison.none())
            record.add(match.key, {"rows": rows})
            typer.echo(f"[{n}/{len(left)}] {match.key} ({ended.seconds:.0f} s)")
    finally:
        write_tables(given.out, wanted, record)
    ours = [row for match in wanted for row in record.rows[match.key]["rows"] if row["method"] == OURS]
    return int(not all(row["ok"] for row in ours))


if __name__ == "__main__":
    raise SystemExit(main())
