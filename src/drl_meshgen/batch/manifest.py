"""Manifests: a table with a model per row, and options of its own where a cell has any."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_meshgen.commands.settings import SettingsError, from_tables, to_toml
from drl_meshgen.errors import InputError
from drl_meshgen.models import is_generated
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.rl.policies import SUFFIX

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".parquet", ".csv")
MODEL, NAME, TRIANGLES = "model", "name", "triangles"
SHORT = {"target_quads": "decompose.target_quads", "target_edge": "decompose.target_edge", "seed": "seed"}
"""Columns that stand for an option of a stage, or of the run."""


@dataclass(frozen=True)
class Entry:
    """One row of a manifest."""

    model: str
    """Model name or path as the row has it."""
    source: str
    """The same, paths as seen from here."""
    name: str
    """Name the row gives it; empty where it gives none."""
    options: MeshOptions
    triangles: int
    """Size of a generated model (count)."""
    refusal: str
    """What is wrong with the row, in one sentence; empty where nothing is."""


def read_manifest(path: Path, options: MeshOptions, triangles: int) -> Iterator[Entry]:
    """Yield the rows of a manifest (Parquet or CSV); empty cells keep `options` and `triangles` as they are.

    Columns are `model` (name, or path relative to the manifest), `name`, `triangles`, `target_quads`, `target_edge`,
    `seed`, and any other option as `stage.field` (a file of `subdomain.policy` relative to the manifest, too). A row
    with a value that cannot be used is yielded with its refusal.

    Raises `InputError` for a file that is no table or has no rows, and for columns that are missing or unknown.
    """
    table = _table(path)
    given = tomllib.loads(to_toml(options))
    _check_columns(path, table, options)
    for number, row in enumerate(table.to_dict("records"), 1):
        cells = {str(name): _plain(value, str(name)) for name, value in row.items() if not _empty(value)}
        try:
            yield _entry(path, cells, given, triangles)
        except (SettingsError, InputError) as error:
            model = str(cells.get(MODEL, ""))
            name = str(cells.get(NAME, "")) or f"{path.stem}-{number}"
            sentence = str(error).removeprefix(f"{path.name}: ")
            yield Entry(model, model, name, options, triangles, f"{path.name}: row {number}: {sentence}")


def _table(path: Path) -> "pd.DataFrame":
    import pandas as pd

    try:
        table = pd.read_parquet(path) if path.suffix.lower() == ".parquet" else pd.read_csv(path, dtype=str)
    except FileNotFoundError:
        raise InputError(path.name, "no such file") from None
    except (OSError, ValueError) as error:  # errors of Arrow and of pandas's parser are ValueErrors
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(path.name, f"cannot be read as a table ({reason})") from None
    if table.empty:
        raise InputError(path.name, "the manifest has no rows", "write a model into each row")
    return table


def _check_columns(path: Path, table: "pd.DataFrame", options: MeshOptions) -> None:
    columns = [str(column) for column in table.columns]
    if MODEL not in columns:
        raise InputError(path.name, f"has no column {MODEL}", f"its columns are {', '.join(columns)}")
    for column in columns:
        stage, _, field = SHORT.get(column, column).partition(".")
        owner = getattr(options, stage, None) if field else options
        if column not in {MODEL, NAME, TRIANGLES} and not hasattr(owner, field or stage):
            known = ", ".join([MODEL, NAME, TRIANGLES, *SHORT])
            raise InputError(path.name, f"has an unknown column {column}", f"known are {known}, and stage.field")


def _entry(path: Path, cells: Mapping[str, Any], given: Mapping[str, Any], triangles: int) -> Entry:
    model = cells.get(MODEL)
    if not isinstance(model, str) or not model.strip():
        raise InputError(path.name, "names no model")
    tables = {name: dict(value) if isinstance(value, dict) else value for name, value in given.items()}
    if "target_quads" in cells and "target_edge" in cells:
        raise InputError(path.name, "gives both target_quads and target_edge", "give one of them")
    for column, value in cells.items():
        if column in {MODEL, NAME, TRIANGLES}:
            continue
        stage, _, field = SHORT.get(column, column).partition(".")
        if field:
            tables.setdefault(stage, {})[field] = value
        else:
            tables[stage] = value
    if "target_quads" in cells:  # a number of quads takes the place of a length that was set before
        tables["decompose"].pop("target_edge", None)
    size = cells.get(TRIANGLES, triangles)
    if type(size) is not int:
        raise InputError(path.name, f"triangles cannot be {size!r}; it is a whole number")
    policy = cells.get("subdomain.policy")
    if isinstance(policy, str) and policy.endswith(SUFFIX):
        tables["subdomain"]["policy"] = str(path.parent / policy)
    source = model if is_generated(model) else str(path.parent / model)
    return Entry(model, source, str(cells.get(NAME, "")), from_tables(tables, path), size, "")


def _empty(value: Any) -> bool:
    return value is None or value == "" or (isinstance(value, float) and value != value)  # noqa: PLR0124 - NaN


def _plain(value: Any, column: str) -> Any:
    """Return a cell as TOML would have it: whole numbers of float columns as such, JSON texts as what they say.

    All cells of a CSV file are texts.
    """
    if column in {MODEL, NAME}:
        return str(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, str):
        try:
            value = json.loads(value)
        except json.JSONDecodeError:
            return value
    return int(value) if isinstance(value, float) and value.is_integer() else value
