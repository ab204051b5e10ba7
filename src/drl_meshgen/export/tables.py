"""Tables as Parquet files."""

from pathlib import Path

import pandas as pd

from drl_meshgen.export.atomic import replacing


def write_table(path: Path | str, table: pd.DataFrame) -> None:
    """Write a table; the index is dropped, the bytes depend on the content alone."""
    with replacing(path) as part:
        table.to_parquet(part, engine="pyarrow", index=False, compression="zstd")


def read_table(path: Path | str) -> pd.DataFrame:
    """Read a table written by `write_table`."""
    return pd.read_parquet(path, engine="pyarrow")
