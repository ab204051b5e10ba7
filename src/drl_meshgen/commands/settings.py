"""Options of a run as a TOML file: one table per stage, one key per field of its options.

What `to_toml` writes, `read_settings` reads back to equal options.
"""

import difflib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from drl_meshgen.assembly import LimitOptions, SubdomainOptions
from drl_meshgen.errors import MeshgenError
from drl_meshgen.pipeline import MeshOptions

T = TypeVar("T")

#: A table of whole numbers by name.
NAMED = tuple[tuple[str, int], ...]


class SettingsError(MeshgenError):
    """A file of settings, or a setting in it, that cannot be used."""

    exit_code = 2


def read_settings(path: Path) -> MeshOptions:
    """Read options; what the file leaves out keeps its default.

    Raises `SettingsError` for a file that is not TOML, an unknown table or key and a value of another type.
    """
    return from_tables(read_toml(path), path)


def chosen(
    config: Path | None,
    counts: Sequence[str] = (),
    target_quads: int | None = None,
    target_edge: float | None = None,
    seed: int | None = None,
    *,
    blocks: int | None = None,
    irregular: int | None = None,
    feature_angle: float | None = None,
    fast: bool = False,
    policy: str | None = None,
    remesh: bool = False,
    strict: bool = False,
) -> MeshOptions:
    """Return the options of a run: defaults, a file over them, what the command line says over both.

    `counts` are texts `NAME=N`, see `DecomposeOptions.fixed`. Raises `SettingsError`.
    """
    options = MeshOptions() if config is None else read_settings(config)
    options = options.sized(target_quads, target_edge)
    options = options.fast() if fast else options
    cleanup = replace(options.cleanup, remesh=remesh or options.cleanup.remesh, strict=strict or options.cleanup.strict)
    fixed = dict(options.decompose.fixed) | dict(_count(text) for text in counts)
    decompose = replace(options.decompose, fixed=tuple(fixed.items()))
    seed = options.seed if seed is None else seed
    limits = LimitOptions(
        options.limits.blocks if blocks is None else blocks,
        options.limits.irregular if irregular is None else irregular,
    )
    seams = options.seams if feature_angle is None else replace(options.seams, feature_angle=feature_angle)
    subdomain = options.subdomain if policy is None else SubdomainOptions(policy)
    return replace(
        options, cleanup=cleanup, seams=seams, decompose=decompose, subdomain=subdomain, limits=limits, seed=seed
    )


def _count(text: str) -> tuple[str, int]:
    name, _, count = text.rpartition("=")
    if not name or not count.strip().isdecimal():
        raise SettingsError(f"--count {text} is not of the form NAME=N, with a whole number N")
    return name.strip(), int(count)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; raises `SettingsError` where it cannot be read or is none."""
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path.name}: not a TOML file ({error})") from None
    except OSError as error:
        raise SettingsError(f"{path.name}: cannot be read ({error.strerror})") from None


def from_tables(data: dict[str, Any], path: Path, prefix: str = "") -> MeshOptions:
    """Return the options that the tables of a file hold, found there under `prefix`; raises `SettingsError`."""
    try:
        return _built(MeshOptions, data, prefix)
    except ValueError as error:
        raise SettingsError(f"{path.name}: {error}") from None


def _built(kind: type[T], table: dict[str, Any], prefix: str) -> T:
    hints = get_type_hints(kind)
    for key in table:
        if key not in hints:
            near = difflib.get_close_matches(key, hints, 1)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"known are {', '.join(hints)}"
            raise ValueError(f"unknown key {prefix}{key}; {hint}")
    values = {key: _converted(hints[key], value, prefix + key) for key, value in table.items()}
    try:
        return kind(**values)
    except ValueError as error:  # options that check themselves
        raise ValueError(f"{prefix.removesuffix('.')}: {error}") from None


def _converted(hint: Any, value: Any, key: str) -> Any:
    """Return a TOML value as the type a field is annotated with; raises ValueError that names the key."""
    if is_dataclass(hint) and isinstance(hint, type) and isinstance(value, dict):
        return _built(hint, value, f"{key}.")
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (one for one in get_args(hint) if one is not NoneType)
    if hint == NAMED and isinstance(value, dict):
        value = [[name, count] for name, count in value.items()]
    if get_origin(hint) is tuple and isinstance(value, list):
        items = get_args(hint)
        if items[-1] is Ellipsis:
            items = items[:1] * len(value)
        if len(items) == len(value):
            return tuple(_converted(item, one, key) for item, one in zip(items, value, strict=True))
    if get_origin(hint) is Literal and value in get_args(hint):
        return value
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is hint:
        return value
    raise ValueError(f"{key} cannot be {value!r}; it is {_described(hint)}")


def _described(hint: Any) -> str:
    if get_origin(hint) is Literal:
        return " or ".join(repr(value) for value in get_args(hint))
    if hint == NAMED:
        return "a table of whole numbers"
    if get_origin(hint) is tuple:
        items = get_args(hint)
        return f"a list of {_described(items[0])}" + ("" if items[-1] is Ellipsis else f", {len(items)} of them")
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    return names.get(hint, "a table")


def to_toml(options: MeshOptions) -> str:
    """Return all options as the text of a TOML file; those that are None are left out."""
    return "\n".join(table_lines(options, "")).strip() + "\n"


def table_lines(options: Any, name: str) -> list[str]:
    """Return the lines of the table called `name` for an options object, and those of the tables in it."""
    hints = get_type_hints(type(options))
    plain, tables = [f"[{name}]"] if name else [], []
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value):
            tables += ["", *table_lines(value, f"{name}.{field.name}" if name else field.name)]
        elif hints[field.name] == NAMED:
            items = ", ".join(f"{literal(key)} = {count}" for key, count in value)
            plain.append(f"{field.name} = {{{items}}}")
        elif value is not None:
            plain.append(f"{field.name} = {literal(value)}")
    return plain + tables


def literal(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if is_dataclass(value):
        items = ((field.name, getattr(value, field.name)) for field in fields(value))
        return f"{{{', '.join(f'{name} = {literal(item)}' for name, item in items)}}}"
    if isinstance(value, tuple):
        return f"[{', '.join(literal(item) for item in value)}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
