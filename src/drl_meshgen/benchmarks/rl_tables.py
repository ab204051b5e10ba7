"""The paper's tables of learned templates, ours and rivals: `python -m drl_meshgen.benchmarks.rl_tables --help`.

Judges every quick method anew, reads long searches and training data from committed files, and writes tables, figures
and a page. Tables whose data are not there are left out, and named.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import typer

from drl_meshgen.benchmarks import rl_paper
from drl_meshgen.benchmarks.pool import PoolOptions, run_jobs
from drl_meshgen.benchmarks.record import Row
from drl_meshgen.benchmarks.rl_figures import draw_figures
from drl_meshgen.benchmarks.rl_judge import FINISHED, GMSH, LEARNERS, OURS, POLICIES, judged, milliseconds_in_batch
from drl_meshgen.benchmarks.tables import markdown, records, write_both
from drl_meshgen.benchmarks.templates import (
    PIPELINE,
    SEARCHES,
    SETS,
    TRANSITIONS,
    domain_named,
    domains_of,
    parameters_in,
    transitions_of,
)
from drl_meshgen.export import read_table, replacing
from drl_meshgen.report.learning import TITLE, ShownTable, build_learning_report
from drl_meshgen.rl.c_domains import TEST_NAME
from drl_meshgen.rl.datasets import Sample
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.templates import instantiate

HEAD = ("set", "index", "method")
NAMES = (*(data.key for data in SETS), PIPELINE, TEST_NAME, TRANSITIONS)
"""Sets of domains, in the order of the tables."""
CHOOSING = (OURS, FINISHED, *SEARCHES, "gradient optimiser", "rule", *LEARNERS)
"""Methods that choose template parameters, in the order of the tables."""
CEILING = ("CMA-ES", "gradient optimiser")
"""Methods whose better reward, domain by domain, is the ceiling."""


@dataclass(frozen=True)
class Column:
    """A metric as it stands in the tables."""

    key: str
    """Name of the metric."""
    label: str
    """Head of the column."""
    percent: bool = False
    """Whether it is shown in percent."""
    digits: int = 3
    """Digits after the point."""
    more: bool | None = True
    """Whether more is better; None: neither."""


ORTHOGONALITY = Column("orthogonality", "orthogonality")
PRINTED = Column("orthogonality_printed", "as printed")
SMOOTHNESS = Column("smoothness", "smoothness")
SHAPE = Column("jacobian_ratio", "shape quality")
FIT = Column("boundary_fit", "boundary fit")
VALID = Column("valid", "domains fully valid", percent=True, digits=1)
VALIDITY = Column("validity", "valid quads", percent=True, digits=2)
REWARD = Column("reward", "reward")
SHARE = Column("share", "of the ceiling", percent=True, digits=1)
TIME = Column("ms", "ms per domain", digits=1, more=False)
BATCHED = Column("ms_64", "ms in a batch of 64", digits=2, more=False)
COMPLIANCE = Column("compliance", "within 15°", percent=True, digits=1)
ERROR = Column("boundary_error", "boundary error", more=False)
RATIO = Column("edge_ratio", "edge ratio", more=False)


def text_of(table: ShownTable) -> str:
    """Return a table in Markdown, the best figures in bold."""
    rows = [
        (group, *(f"**{cell}**" if (group, i, j) in table.best else cell for j, cell in enumerate(row)))
        for group, lines in table.groups
        for i, row in enumerate(lines)
    ]
    return f"## {table.title}\n\n{table.note}\n\n{markdown(('set', *table.head), rows)}"


def summary_of(rows: Sequence[Row], methods: Sequence[str], columns: Sequence[Column]) -> list[Row]:
    """Return mean, standard deviation and count of each metric per set and method, methods in the given order."""
    summary: list[Row] = []
    for name in dict.fromkeys(row["set"] for row in rows):
        for method in methods:
            part = [row for row in rows if (row["set"], row["method"]) == (name, method)]
            if not part:
                continue
            line: Row = {"set": name, "method": method, "domains": len(part)}
            for column in columns:
                mean, deviation = spread(part, column)
                line |= {f"{column.key}_mean": mean, f"{column.key}_std": deviation}
            summary.append(line)
    return summary


def spread(rows: Sequence[Row], column: Column) -> tuple[float, float]:
    """Return mean and standard deviation of a metric over the rows that have it; NaN where none has."""
    values = np.array([row.get(column.key, np.nan) for row in rows], float)
    values = values[np.isfinite(values)]
    return (float(values.mean()), float(values.std())) if len(values) else (np.nan, np.nan)


def shown(column: Column, mean: float, deviation: float | None) -> str:
    """Return a figure as it is printed."""
    if np.isnan(mean):
        return "–"
    factor, unit = (100, " %") if column.percent else (1, "")
    text = f"{factor * mean:.{column.digits}f}"
    spread = "" if deviation is None or column is VALID else f" ± {factor * deviation:.{column.digits}f}"
    return text + spread + unit


@dataclass(frozen=True)
class Plan:
    """A table to be made."""

    key: str
    """Short name."""
    title: str
    """Heading."""
    note: str
    """What it shows."""
    columns: tuple[Column, ...]
    """Metrics, in order."""


def comparison(plan: Plan, summary: Sequence[Row], printed: Mapping[tuple[str, str], rl_paper.Printed]) -> ShownTable:
    """Return a table of methods by sets with the paper's figures in a last column; the best of each column marked."""
    groups, best = [], set()
    labels = {column.key: column.label for column in plan.columns} | {"ms": "time"}
    for name in dict.fromkeys(row["set"] for row in summary):
        part, lines = [row for row in summary if row["set"] == name], []
        for row in part:
            paper = printed.get((name, row["method"]), {})
            said = "; ".join(f"{labels.get(metric, metric)} {figure}" for metric, figure in paper.items())
            cells = [shown(c, row[f"{c.key}_mean"], row[f"{c.key}_std"]) for c in plan.columns]
            lines.append((row["method"], str(row["domains"]), *cells, said))
        for j, column in enumerate(plan.columns):
            sign, factor = (1 if column.more else -1), (100 if column.percent else 1)
            means = np.round([sign * factor * row[f"{column.key}_mean"] for row in part], column.digits)
            best |= {(name, int(i), j + 2) for i in np.nonzero(means == np.fmax.reduce(means))[0]}
        groups.append((name, tuple(lines)))
    head = ("method", "domains", *(column.label for column in plan.columns), "the paper")
    return ShownTable(plan.key, plan.title, plan.note, head, tuple(groups), frozenset(best))


def with_ceiling(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with `share`: the reward over the better reward of the `CEILING` methods on that domain."""
    tops: dict[tuple[str, int], float] = {}
    for row in rows:
        if row["method"] in CEILING:
            key = row["set"], row["index"]
            tops[key] = max(tops.get(key, -np.inf), row["reward"])
    return [row | {"share": row["reward"] / tops.get((row["set"], row["index"]), np.nan)} for row in rows]


def staged(folder: Path) -> list[Row]:
    """Return metrics of the meshes that `stages.parquet` has parameters of."""
    rows = []
    for row in records(read_table(folder / "stages.parquet")):
        domain = domain_named(row["set"], row["index"]).domain
        mesh = instantiate(domain, parameters_in(row))
        rows.append({"stage": row["stage"]} | plane_metrics(domain, np.array(mesh.points), np.array(mesh.quads)))
    return rows


def by_rows(plan: Plan, rows: Sequence[Row], by: str, printed: Mapping[str, rl_paper.Printed]) -> ShownTable:
    """Return a table with one row per value of the column `by` and the paper's figure beside each of ours."""
    lines = []
    for label in dict.fromkeys(row[by] for row in rows):
        part, paper = [row for row in rows if row[by] == label], printed.get(label, {})
        cells: list[str] = []
        for column in plan.columns:
            mean, deviation = spread(part, column)
            cells += [shown(column, mean, deviation if len(part) > 1 else None), paper.get(column.key, "–")]
        lines.append((label, *cells))
    head = (by, *(text for column in plan.columns for text in (column.label, "the paper")))
    return ShownTable(plan.key, plan.title, plan.note, head, (("", tuple(lines)),))


WEIGHTED = Plan(
    "table1",
    "Table 1: weights of the reward",
    "Top-level weights, in the variant with free boundary nodes: quality alone, fitting alone, both.",
    (ERROR, ORTHOGONALITY, VALIDITY, REWARD),
)
LEARNED = Plan(
    "table2",
    "Table 2: early and late in training",
    "One training domain at 10 % of training and at its end.",
    (ORTHOGONALITY, COMPLIANCE, RATIO, VALIDITY, REWARD),
)
AGAINST_SEARCHES = Plan(
    "table3",
    "Table 3: against searches",
    "Mean and standard deviation over the domains of a set. Orthogonality by the worst corner of a quad, and as the "
    "paper prints the formula. Ceiling: the better of CMA-ES and the gradient optimiser on each domain. Ours and the "
    "gradient optimiser may use waves and swells beyond the paper's parameters, the rule grading; the others may not. "
    "Finished: with one more layer, after which every interior node moves by itself, as the command fill does it.",
    (ORTHOGONALITY, PRINTED, SMOOTHNESS, SHAPE, FIT, VALID, REWARD, SHARE, TIME, BATCHED),
)
AGAINST_GMSH = Plan(
    "table4",
    "Table 4: against Gmsh",
    "Gmsh gets the same boundary nodes. Its time is that inside the mesher, ours that of choosing and finishing.",
    (ORTHOGONALITY, PRINTED, SMOOTHNESS, SHAPE, FIT, VALIDITY, VALID, TIME),
)
HARVESTED = Plan(
    "pipeline",
    "Test-Pipeline",
    "Caps of real surfaces in their disk charts, and their outlines; every method chooses corners freely.",
    AGAINST_SEARCHES.columns,
)

TRANSITIONAL = Plan(
    "transitions",
    "C-type transitions",
    "Four-sided domains with more nodes on one side than on the one across: Test-C, drawn, and patches of tubes that "
    "lose columns, from the pipeline. Ours and the gradient optimiser choose numbers of cells as well; the latter is "
    "the ceiling. The rule is balanced counts and Tutte's embedding.",
    AGAINST_SEARCHES.columns,
)


def tables_of(folder: Path) -> list[ShownTable]:
    """Return every table whose data are in the folder."""
    made = []
    if (folder / "ablation.parquet").is_file():
        found = records(read_table(folder / "ablation.parquet"))
        made.append(by_rows(WEIGHTED, found, "configuration", rl_paper.TABLE_1))
    if (folder / "stages.parquet").is_file():
        made.append(by_rows(LEARNED, staged(folder), "stage", rl_paper.TABLE_2))
    rows = with_ceiling(all_rows(folder))
    drawn = [row for row in rows if row["set"] in {data.key for data in SETS}]
    harvested = [row for row in rows if row["set"] == PIPELINE]
    transitional = [row for row in rows if row["set"] in {TEST_NAME, TRANSITIONS}]
    for plan, part, methods, printed in (
        (AGAINST_SEARCHES, drawn, CHOOSING, rl_paper.TABLE_3),
        (AGAINST_GMSH, drawn, (OURS, FINISHED, *GMSH), rl_paper.TABLE_4),
        (HARVESTED, harvested, (*CHOOSING, *GMSH), {}),
        (TRANSITIONAL, transitional, (OURS, FINISHED, "gradient optimiser", "rule", *GMSH), {}),
    ):
        if part:
            made.append(comparison(plan, summary_of(part, methods, plan.columns), printed))
    return made


def all_rows(folder: Path) -> list[Row]:
    """Return the rows of quick methods and long searches, those of searches with the milliseconds they took."""
    rows = _timed(folder, "judged", "judged-ms")
    if (folder / "searches.parquet").is_file():
        rows += [row | {"ms": 1000 * row["seconds"]} for row in _timed(folder, "searches", "searches-seconds")]
    return rows


def _timed(folder: Path, name: str, times: str) -> list[Row]:
    return records(read_table(folder / f"{name}.parquet").merge(read_table(folder / f"{times}.parquet"), on=list(HEAD)))


def judge(folder: Path, samples: Sequence[Sample], methods: Sequence[str], options: PoolOptions) -> None:
    """Judge these methods on these domains and write `judged.{parquet,csv}`, times apart.

    Rows there of other methods, or of other sets, stay.
    """
    anew = {(sample.set, method) for sample in samples for method in methods}
    rows: list[Row] = []
    if (folder / "judged.parquet").is_file():
        rows = [row for row in _timed(folder, "judged", "judged-ms") if (row["set"], row["method"]) not in anew]
    for n, ended in enumerate(run_jobs(partial(judged, folder=folder, methods=methods), samples, options), 1):
        rows += ended.result or []
        if n % 10 == 0 or ended.cause:
            sample = samples[ended.index]
            typer.echo(f"[{n}/{len(samples)}] {sample.set} {sample.index} {ended.cause}")
    for name in (data.key for data in SETS if (data.key, OURS) in anew):
        taken = milliseconds_in_batch([sample for sample in samples if sample.set == name])
        rows = [row | {"ms_64": taken} if (row["set"], row["method"]) == (name, OURS) else row for row in rows]
    order = [*POLICIES, *LEARNERS, *GMSH]
    rows.sort(key=lambda row: (NAMES.index(row["set"]), row["index"], order.index(row["method"])))
    table = pd.DataFrame(rows)
    write_both(folder / "judged", table.drop(columns=["ms", "ms_64"], errors="ignore"))
    write_both(folder / "judged-ms", table.reindex(columns=[*HEAD, "ms", "ms_64"]).round({"ms": 2, "ms_64": 2}))


def write_page(folder: Path, tables: Sequence[ShownTable]) -> None:
    """Write `tables.md`."""
    says = "Written by `make rl-tables`; [README.md](../README.md) says what is measured."
    parts = [f"# {TITLE}", says, *map(text_of, tables)]
    missing = [name for name in ("ablation", "stages", "searches") if not (folder / f"{name}.parquet").is_file()]
    if missing:
        parts.append(f"Left out, as their data are not there: {', '.join(f'`{name}.parquet`' for name in missing)}.")
    with replacing(folder / "tables.md") as path:
        path.write_text("\n\n".join(parts) + "\n", "utf-8")


def main(arguments: list[str] | None = None) -> int:
    """Judge, and write tables, figures and the page."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.benchmarks.rl_tables", description=__doc__)
    names = [*POLICIES, *LEARNERS, *GMSH]
    parser.add_argument("--sets", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument(
        "--methods", nargs="+", choices=names, default=names, metavar="NAME", help="rows of others stay"
    )
    parser.add_argument("--limit", type=int, metavar="N", help="only the first N domains of each set")
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/rl"), help="folder of data and tables")
    parser.add_argument("--report", type=Path, metavar="DIR", help="folder of the page")
    parser.add_argument("--workers", type=int, default=PoolOptions.workers, metavar="N", help="processes; 0: cores")
    parser.add_argument("--drawn-only", action="store_true", help="judge nothing, use the rows there")
    given = parser.parse_args(arguments)
    if not given.drawn_only:
        samples = domains_of(given.out, given.sets, given.limit) + transitions_of(given.out, given.sets, given.limit)
        judge(given.out, samples, given.methods, PoolOptions(given.workers, jobs=1000))
    tables = tables_of(given.out)
    columns = (*AGAINST_SEARCHES.columns, VALIDITY, COMPLIANCE, RATIO, ERROR)
    summary = summary_of(with_ceiling(all_rows(given.out)), (*CHOOSING, *GMSH), columns)
    write_both(given.out / "summary", pd.DataFrame(summary))
    write_page(given.out, tables)
    figures = draw_figures(given.out)
    if given.report:
        typer.echo(build_learning_report(given.report, tables, figures, OURS))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
