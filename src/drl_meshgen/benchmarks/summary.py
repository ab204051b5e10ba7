"""The summary of a robustness run as Markdown, and what makes a surface hard."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.benchmarks.examine import Status
from drl_meshgen.benchmarks.record import Row
from drl_meshgen.benchmarks.tables import markdown, records
from drl_meshgen.export import read_table, replacing

THROUGH = Status.MESHED
HARDEST = 20
SHEET = "hardest.jpg"
"""Picture beside the summary, shown where it exists."""
AREA_RATIO_SCALE = 10.0
"""Ratio of neighbouring areas that counts as one, the most."""


def hardness(table: pd.DataFrame) -> pd.Series:
    """Return a score per row: how far from a perfect mesh, 0 to 4; rows that did not go through have 10 on top.

    The sum of four terms between 0 and 1: what the smallest and the largest angle lack to 90 degrees over 90, warp
    over 180 degrees, logarithm of the area ratio over that of `AREA_RATIO_SCALE`. A row without a mesh scores 14.
    """
    ratio = np.log(table["area_ratio"].clip(lower=1)) / np.log(AREA_RATIO_SCALE)
    terms = (1 - table["min_angle"] / 90, table["max_angle"] / 90 - 1, table["warp"] / 180, ratio)
    score = pd.concat(terms, axis=1).clip(0, 1).fillna(1).sum(axis=1)
    return score + 10 * (table["status"] != THROUGH.value)


def blanked(sentence: str) -> str:
    """Return a sentence without its figures: the same for the same cause."""
    return re.sub(r"-?\d[\d.,e+-]*", "n", sentence)


def hardest(table: pd.DataFrame, count: int = HARDEST) -> pd.DataFrame:
    """Return the hardest row of each of the hardest surfaces, hardest first, with the column `score`.

    Failed rows are taken from every cause by turns, so that one cause does not fill the list.
    """
    scored = table.assign(score=hardness(table))
    scored = scored.sort_values("score", ascending=False, kind="stable").drop_duplicates(["kind", "surface"])
    through = scored["status"] == THROUGH.value
    turn = scored.groupby([blanked(sentence) for sentence in scored["sentence"]], sort=False).cumcount()
    scored = scored.assign(through=through, turn=turn.where(~through, 0))
    order = scored.sort_values(["through", "turn", "score"], ascending=[True, True, False], kind="stable")
    return order.drop(columns=["through", "turn"]).head(count).reset_index(drop=True)


def _shares(rows: list[Row]) -> str:
    lines = []
    groups = list(dict.fromkeys((row["kind"], row["remesh"], row["target"]) for row in rows))
    for kind, remesh, target in groups:
        part = [row["status"] for row in rows if (row["kind"], row["remesh"], row["target"]) == (kind, remesh, target)]
        others = ", ".join(f"{part.count(s.value)} {s.value}" for s in Status if s is not THROUGH and s.value in part)
        through = part.count(THROUGH.value)
        share = f"{through} of {len(part)} ({through / len(part):.0%})"
        lines.append((kind, "yes" if remesh else "no", f"{target:,}", share, others))
    return markdown(("kind", "remeshed", "quads", "through", "others"), lines)


def _label(row: Row) -> str:
    return f"{row['surface']} ({row['kind']}{', remeshed' if row['remesh'] else ''}, {row['target']:,})"


def _failures(rows: list[Row]) -> str:
    causes: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row["status"] != THROUGH.value:
            causes.setdefault((row["status"], blanked(row["sentence"])), []).append(row)
    if not causes:
        return "None."
    lines = []
    for (status, _), part in sorted(causes.items(), key=lambda item: -len(item[1])):
        more = f" and {len(part) - 3} more" if len(part) > 3 else ""
        lines.append((str(len(part)), status, part[0]["sentence"], ", ".join(map(_label, part[:3])) + more))
    return markdown(("count", "status", "cause, of the first", "where"), lines)


def _hardest(table: pd.DataFrame) -> str:
    lines = []
    for row in records(hardest(table)):
        cells = ("", "", "")
        if not math.isnan(row["quads"]):
            cells = (
                f"{row['min_angle']:.1f} – {row['max_angle']:.1f}",
                f"{row['warp']:.1f}",
                f"{row['area_ratio']:.2f}",
            )
        lines.append((_label(row), f"{row['score']:.2f}", row["status"], *cells))
    return markdown(("surface", "score", "status", "angles", "warp", "area ratio"), lines)


def write_summary(folder: Path) -> None:
    """Write `robustness.md` from the tables in a folder."""
    table = read_table(folder / "robustness.parquet")
    seconds = read_table(folder / "robustness-seconds.parquet")["seconds"]
    rows = records(table)
    through = [row["status"] for row in rows].count(THROUGH.value)
    share = f"{through} of {len(rows)} runs went through, {through / max(len(rows), 1):.1%}"
    times = f"{seconds.median():.1f} s per run in the middle, {seconds.max():.1f} s at most"
    parts = [
        "# Robustness",
        "Written by `make robustness`; [README.md](README.md) says what is measured. The rows are in `robustness.csv`.",
        f"**{share}**: meshed, above the quality gate, without defects. {times}.",
        _shares(rows),
        "## What did not go through",
        _failures(rows),
        "## The hardest",
        "Hardest run of each of the hardest surfaces, failures first; the score is defined in [README.md](README.md).",
        _hardest(table),
    ]
    if (folder / SHEET).exists():
        parts.append(f"![Blocks of the hardest surfaces]({SHEET})")
    with replacing(folder / "robustness.md") as path:
        path.write_text("\n\n".join(parts) + "\n", "utf-8")
