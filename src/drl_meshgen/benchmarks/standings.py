"""Who is best in which column: wins and losses of our mesh, and the page of the quality benchmark."""

import math
from collections.abc import Sequence
from pathlib import Path

from drl_meshgen.benchmarks.columns import FIGURES, RANKED
from drl_meshgen.benchmarks.record import Row
from drl_meshgen.benchmarks.tables import markdown, records
from drl_meshgen.export import read_table, replacing
from drl_meshgen.report.inputs import OURS

_PRINTED_COLUMNS = ("min_angle", "max_angle", "warp", "area_ratio", "orthogonality", "irregular", "blocks")
_PRINTED_FIGURES = (
    ("hand", 2000, "QuadWild", (50, 135, 53, 1.85, 0.915, 36, 349)),
    ("hand", 8000, "QuadWild", (44, 129, 36, 1.78, 0.920, 36, 758)),
    ("hand", 8000, "AutoRemesher", (41, 140, 50, 2.30, 0.948, 36, 2519)),
    ("giraffe", 2000, "QuadWild", (36, 155, 122, 2.07, 0.835, 50, 532)),
    ("giraffe", 8000, "QuadWild", (35, 147, 115, 2.25, 0.834, 50, 3906)),
)
PRINTED: tuple[Row, ...] = tuple(
    {"surface": surface, "target": target, "method": f"{method} (printed)", "ok": True, "cause": "", "defects": ""}
    | dict.fromkeys((*FIGURES, "seconds"), math.nan)
    | dict(zip(_PRINTED_COLUMNS, figures, strict=True))
    for surface, target, method, figures in _PRINTED_FIGURES
)
"""Figures of meshers that are not run here, as they were measured once with the same definitions, on real models of
the same kind: not on the surfaces of this benchmark."""


def _read(row: Row, name: str) -> float:
    """Return a figure as it reads in the table, signed so that less is better; infinite where there is none."""
    figure = FIGURES[name]
    value = row[name]
    if not row["ok"] or math.isnan(value):
        return math.inf
    return round(-value if figure.more_is_better else value, figure.digits)


def ahead(ours: Row, rivals: Sequence[Row], name: str) -> int | None:
    """Return 1 where our figure is better than that of every rival, 0 where it equals the best, -1 where it is worse.

    None where no rival has that figure and neither have we.
    """
    mine, best = _read(ours, name), min((_read(row, name) for row in rivals), default=math.inf)
    return None if mine == best == math.inf else (mine < best) - (mine > best)


def _rounds(rows: list[Row]) -> list[tuple[Row, list[Row]]]:
    """Return our row and the others, match by match."""
    keys = list(dict.fromkeys((row["surface"], row["target"]) for row in rows))
    matches = [[row for row in rows if (row["surface"], row["target"]) == key] for key in keys]
    return [(match[0], match[1:]) for match in matches if match[0]["method"] == OURS]


def _tally(rounds: Sequence[tuple[Row, Sequence[Row]]]) -> str:
    lines = []
    for name in RANKED:
        results = [ahead(ours, rivals, name) for ours, rivals in rounds]
        behind = [
            f"{ours['surface']} {ours['target']:,}" for (ours, _), r in zip(rounds, results, strict=True) if r == -1
        ]
        counts = (str(results.count(value)) for value in (1, 0, -1))
        lines.append((FIGURES[name].head, *counts, ", ".join(behind)))
    return markdown(("column", "ahead", "equal", "behind", "behind at"), lines)


def _cells(row: Row, rows: Sequence[Row]) -> list[str]:
    cells = []
    for name, figure in FIGURES.items():
        value = row[name]
        text = "" if math.isnan(value) else f"{value:,.{figure.digits}f}"
        best = name in RANKED and text and _read(row, name) == min(_read(other, name) for other in rows)
        cells.append(f"**{text}**" if best else text)
    return cells


def _lines(rounds: Sequence[tuple[Row, Sequence[Row]]]) -> str:
    lines = []
    for ours, rivals in rounds:
        rows = (ours, *rivals)
        for row in rows:
            remark = "; ".join(text for text in (row["cause"], row["defects"]) if text)
            lines.append((f"{row['surface']} {row['target']:,}", row["method"], *_cells(row, rows), remark))
    return markdown(("surface", "method", *(figure.head for figure in FIGURES.values()), "remark"), lines)


def write_standings(folder: Path) -> None:
    """Write `quality.md` from the table in a folder."""
    rounds = _rounds(records(read_table(folder / "quality.parquet")))
    ran = [(ours, [row for row in rivals if row["ran"]]) for ours, rivals in rounds]
    printed = [(ours, [row for row in rivals if not row["ran"]]) for ours, rivals in rounds]
    printed = [(ours, rivals) for ours, rivals in printed if rivals]
    parts = [
        "# Quality against rivals",
        "Written by `make bench-quality`; [README.md](README.md) says what is measured. The rows are in `quality.csv`.",
        f"## Against the rivals that ran here, {len(ran)} matches",
        _tally(ran),
    ]
    if printed:
        parts += [
            "## Against printed figures",
            "Of meshers that are not run here, measured once on real models of the same kind, not on these surfaces.",
            _tally(printed),
        ]
    parts += ["## Every match", "The best of each match in bold.", _lines(rounds)]
    with replacing(folder / "quality.md") as path:
        path.write_text("\n\n".join(parts) + "\n", "utf-8")
