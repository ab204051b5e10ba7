"""Long searches for template parameters on the test sets: `python -m drl_meshgen.benchmarks.templates --help`.

SQP, GA and CMA-ES search afresh for every domain; what they find is kept for the tables of `benchmarks.rl_tables`.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import typer

from drl_meshgen.benchmarks.pool import PoolOptions, run_jobs
from drl_meshgen.benchmarks.record import Record, Row
from drl_meshgen.benchmarks.tables import write_both
from drl_meshgen.errors import InputError
from drl_meshgen.rl.c_domains import TEST, TEST_NAME, samples_of_test
from drl_meshgen.rl.datasets import DataSet, Sample, read_samples, samples_of
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.rivals import EvolutionPolicy, GeneticPolicy, SqpPolicy
from drl_meshgen.store.source import source_digest
from drl_meshgen.templates import Domain, OParameters, Policy, instantiate

SEARCHES: dict[str, Policy] = {"SQP": SqpPolicy(), "CMA-ES": EvolutionPolicy(), "GA": GeneticPolicy()}
"""Searches by their names in the tables, at the budgets of the paper."""
SETS = (DataSet.TEST_STANDARD, DataSet.TEST_HARD)
PIPELINE = "test-pipeline"
"""Name of the set that is harvested from the pipeline and read from a file of that name."""
TRANSITIONS = "pipeline-transitions"
"""Name of those of its domains that C-type templates fill."""
HEAD = ("set", "index", "method")


@dataclass(frozen=True, eq=False)
class Search:
    """One method on one domain."""

    method: str
    """Name in the tables."""
    sample: Sample
    """The domain."""

    @property
    def key(self) -> str:
        """Name of the search, unlike that of any other."""
        return f"{self.sample.set} {self.sample.index} {self.method}"


def domains_of(folder: Path, names: Sequence[str], limit: int | None = None) -> list[Sample]:
    """Return the domains of the test sets of these names that O-type templates fill; Test-Pipeline from `folder`."""
    samples = []
    for data in SETS:
        if data.key in names:
            samples += samples_of(data, range(min(data.size, limit or data.size)))
    if PIPELINE in names and (folder / f"{PIPELINE}.parquet").is_file():
        samples += [one for one in read_samples(folder / f"{PIPELINE}.parquet") if one.is_o_type][:limit]
    return samples


def transitions_of(folder: Path, names: Sequence[str], limit: int | None = None) -> list[Sample]:
    """Return the domains of the test sets of these names that C-type templates fill; harvested ones from `folder`."""
    samples = list(samples_of_test(range(min(TEST[1], limit or TEST[1])))) if TEST_NAME in names else []
    if TRANSITIONS in names and (folder / f"{PIPELINE}.parquet").is_file():
        harvested = [one for one in read_samples(folder / f"{PIPELINE}.parquet") if one.transition]
        samples += [replace(one, set=TRANSITIONS) for one in harvested[:limit]]
    return samples


def domain_named(name: str, index: int) -> Sample:
    """Return a domain of a drawn set by the set's name; raises `InputError` for a name that is none."""
    found = [data for data in DataSet if data.key == name]
    if not found:
        raise InputError("set of domains", f"{name!r} is not known", f"take one of {', '.join(d.key for d in DataSet)}")
    return next(samples_of(found[0], [index]))


def parameter_row(parameters: OParameters) -> Row:
    """Return the parameters of the paper's O-type template as columns; waves, swells and grading are left out."""
    p = parameters
    lists = {"singular": p.singular.ravel().tolist(), "bulges": p.bulges.ravel().tolist()}
    return {"i0": p.i0, "m": p.m, "n": p.n, "layers": p.layers} | lists


def parameters_in(row: Row) -> OParameters:
    """Return the parameters of a row; columns `waves`, `swells` and `grading` count where there are any."""
    shapes = {"singular": (4, 2), "bulges": (8, 2), "waves": (8, 2, 2), "swells": (4, 3, 2)}
    arrays = {key: np.array(row[key], float).reshape(shape) for key, shape in shapes.items() if key in row}
    i0, m, n, layers = (int(row[key]) for key in ("i0", "m", "n", "layers"))
    return OParameters(i0, m, n, layers, **arrays, grading=float(row.get("grading", 1.0)))


def searched(search: Search) -> Row:
    """Run one search; return its row with metrics, parameters and CPU seconds."""
    domain: Domain = search.sample.domain
    begin = time.process_time()
    parameters = SEARCHES[search.method].choose(domain)
    seconds = time.process_time() - begin
    mesh = instantiate(domain, parameters)
    head = {"set": search.sample.set, "index": search.sample.index, "method": search.method}
    figures = plane_metrics(domain, np.array(mesh.points), np.array(mesh.quads))
    return head | parameter_row(parameters) | figures | {"seconds": seconds}


def write_tables(folder: Path, searches: Sequence[Search], record: Record) -> None:
    """Write `searches.{parquet,csv}`, and the times apart, as they differ from run to run."""
    rows = [record.rows[one.key] for one in searches if one.key in record.rows]
    if rows:
        table = pd.DataFrame(rows)
        write_both(folder / "searches", table.drop(columns="seconds"))
        timed = table.reindex(columns=[*HEAD, "seconds"])
        write_both(folder / "searches-seconds", timed.assign(seconds=timed["seconds"].round(2)))


def main(arguments: list[str] | None = None) -> int:
    """Run the searches; 1 where one ended without a result, else 0."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.benchmarks.templates", description=__doc__)
    keys = [data.key for data in SETS] + [PIPELINE]
    parser.add_argument("--sets", nargs="+", choices=keys, default=keys)
    parser.add_argument("--methods", nargs="+", choices=list(SEARCHES), default=list(SEARCHES))
    parser.add_argument("--limit", type=int, metavar="N", help="only the first N domains of each set")
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/rl"), help="folder of the tables")
    parser.add_argument("--work", type=Path, default=Path("out/rl-baselines"), help="folder of the rows found so far")
    parser.add_argument("--resume", action="store_true", help="keep what an earlier run of the same code found")
    parser.add_argument("--workers", type=int, default=PoolOptions.workers, metavar="N", help="processes; 0: cores")
    given = parser.parse_args(arguments)
    samples = domains_of(given.out, given.sets, given.limit)
    searches = [Search(method, one) for method in given.methods for one in samples]
    record = Record(given.work / "searches.jsonl", source_digest(("drl_meshgen.rl.rivals",)), resume=given.resume)
    left = [one for one in searches if one.key not in record.rows]
    typer.echo(f"{len(searches)} searches, {len(searches) - len(left)} of them done before")
    lost = 0
    try:
        for n, ended in enumerate(run_jobs(searched, left, PoolOptions(given.workers, jobs=1000)), 1):
            one = left[ended.index]
            if ended.result is None:
                lost += 1
                typer.echo(f"[{n}/{len(left)}] {one.key}: {ended.cause}", err=True)
                continue
            record.add(one.key, ended.result)
            typer.echo(f"[{n}/{len(left)}] {one.key}: {ended.result['reward']:.4f} ({ended.seconds:.1f} s)")
    finally:
        write_tables(given.out, searches, record)
    return int(lost > 0)


if __name__ == "__main__":
    raise SystemExit(main())
