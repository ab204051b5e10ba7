"""Benchmark runs as folders: `OUT/NAME` with tables that are the same but for times, and what moved since another run.

`quality.parquet` and `.csv`, `setting.json` (versions and parameters) and `index.md` are the same, bit by bit, whenever
the same code meshes the same surfaces. Times are in `seconds.parquet` and `.csv`, what depends on an earlier run in
`moved.parquet`, `.csv` and `.md`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from drl_meshgen.benchmarks.columns import FIGURES
from drl_meshgen.benchmarks.moved import Movement
from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table, replacing, write_table
from drl_meshgen.models.reading import READABLE
from drl_meshgen.store import Stage
from drl_meshgen.store.source import libraries

LAST = "last"
"""Name that stands for the run that was written last."""
QUALITY, SETTING = "quality.parquet", "setting.json"
MOST_ROWS = 200
"""Most movements that a page shows (count); the table has all."""


def run_folder(out: Path, name: str) -> Path:
    """Return the folder of a run; raises `InputError` where the name is that of no folder, or stands for another."""
    if not name.strip(".") or Path(name).name != name or name == LAST:
        raise InputError(name, "is no name for a benchmark run", "take letters, digits and dashes")
    return out / name


def surfaces_in(folder: Path) -> list[str]:
    """Return all files of surfaces below a folder, sorted. Raises `InputError` where there are none."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix.lower() in READABLE)
    if not found:
        raise InputError(folder.name or str(folder), "holds no files of surfaces", f"known are {' '.join(READABLE)}")
    return [str(path) for path in found]


def earlier(out: Path, against: str, name: str) -> tuple[str, pd.DataFrame] | None:
    """Return name and quality table of an earlier run; None where the last one is asked for and there is none.

    Raises `InputError` where a named one does not exist.
    """
    tables = {path.parent.name: path for path in sorted(out.glob(f"*/{QUALITY}"))}
    if against == LAST:
        others = [one for one in tables if one != name]
        if not others:
            return None
        against = max(others, key=lambda one: (tables[one].stat().st_mtime_ns, one))
    if against not in tables:
        raise InputError(against, "no such benchmark run", f"known are {', '.join(tables) or 'none'}")
    return against, read_table(tables[against])


def other_setting(folder: Path, setting: Mapping[str, Any]) -> str:
    """Return in words which parameters or versions of the run in `folder` differ from these; empty where none does.

    A run whose setting cannot be read differs in everything.
    """
    try:
        former = json.loads((folder / SETTING).read_text("utf-8"))
    except (OSError, ValueError):
        return "its setting cannot be read"
    differing = [key for key in sorted({*former, *setting}) if former.get(key) != setting.get(key)]
    return f"other {', '.join(differing)}" if differing else ""


def versions(stages: Sequence[Stage[Any, Any]]) -> dict[str, Any]:
    """Return versions of our code, Python, the platform and of every library that any of the stages depends on."""
    made = stages[0].made(None)
    used = libraries(tuple(module for stage in stages for module in stage.modules))
    return {key: made[key] for key in ("code", "python", "platform")} | {"libraries": dict(sorted(used.items()))}


def write_run(
    folder: Path,
    quality: pd.DataFrame,
    seconds: pd.DataFrame,
    setting: Mapping[str, Any],
    movements: tuple[str, pd.DataFrame] | None = None,
) -> None:
    """Write a run: `quality` with a row per surface, `seconds` with a row per stage, `setting` as JSON data.

    `movements` has the name of the run it was held to, and what `moved` says of it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {"quality": quality, "seconds": seconds} | ({} if movements is None else {"moved": movements[1]})
    texts = {"index.md": _page(quality, setting)}
    texts[SETTING] = json.dumps(dict(setting), indent=1, sort_keys=True) + "\n"
    if movements is not None:
        texts["moved.md"] = moved_page(*movements)
    for name, table in tables.items():
        write_table(folder / f"{name}.parquet", table)
        texts[f"{name}.csv"] = table.to_csv(index=False, lineterminator="\n", float_format="%.10g")
    for name, text in texts.items():
        with replacing(folder / name) as part:
            part.write_text(text, "utf-8")
    if movements is None:
        for path in folder.glob("moved.*"):  # of an earlier run of this name
            path.unlink()


def summary(movements: pd.DataFrame) -> str:
    """Return how much moved, in words."""
    counts = movements["movement"].value_counts()
    told = [f"{counts[one.value]} {one.value}" for one in Movement if one.value in counts]
    return ", ".join(told) or "nothing moved"


def moved_page(name: str, movements: pd.DataFrame) -> str:
    """Return what moved against the run called `name` as Markdown."""
    lines = [f"## Against {name}: {summary(movements)}", ""]
    if len(movements):
        lines += ["| movement | surface | metric | before | after |", "| --- | --- | --- | ---: | ---: |"]
    for row in movements.head(MOST_ROWS).to_dict("records"):
        cells = (row["movement"], row["surface"], _head(row["metric"]), row["before"], row["after"])
        lines.append(f"| {' | '.join(cells)} |")
    if len(movements) > MOST_ROWS:
        lines += ["", f"and {len(movements) - MOST_ROWS} more in `moved.csv`"]
    return "\n".join([*lines, ""])


def _head(metric: str) -> str:
    return FIGURES[metric].head if metric in FIGURES else metric


def _page(quality: pd.DataFrame, setting: Mapping[str, Any]) -> str:
    """Return the page of a run as Markdown, without times."""
    shown = [metric for metric in FIGURES if metric in quality]
    lines = ["# Benchmark", "", f"{len(quality)} surfaces, {setting['target_quads']} quads wanted.", ""]
    lines.append("| surface | verdict | " + " | ".join(map(_head, shown)) + " |")
    lines.append("| --- | --- |" + " ---: |" * len(shown))
    for row in quality.to_dict("records"):
        cells = [f"{row[m]:.{FIGURES[m].digits}f}" if np.isfinite(row[m]) else "–" for m in shown]
        lines.append(f"| {row['surface']} | {row['verdict']} | {' | '.join(cells)} |")
    remarks = [f"- {row['remark']}" for row in quality.to_dict("records") if row["remark"]]
    found = setting["versions"]
    made = [f"drl-meshgen {found['code']}", f"Python {found['python']}", found["platform"]]
    libraries = [f"{library} {version}" for library, version in found["libraries"].items()]
    return "\n".join(
        [*lines, "", *remarks, *([""] if remarks else []), "Made with " + ", ".join(made + libraries) + ".", ""]
    )
