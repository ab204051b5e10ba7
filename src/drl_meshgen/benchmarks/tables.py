"""Tables of the benchmarks as files and in Markdown."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from drl_meshgen.benchmarks.record import Row
from drl_meshgen.export import replacing, write_table


def write_both(stem: Path, table: pd.DataFrame) -> None:
    """Write `stem.parquet` and `stem.csv`, the latter with six digits."""
    write_table(stem.with_name(f"{stem.name}.parquet"), table)
    with replacing(stem.with_name(f"{stem.name}.csv")) as path:
        table.to_csv(path, index=False, float_format="%.6g")


def records(table: pd.DataFrame) -> list[Row]:
    """Return the rows of a table by column name."""
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)
