"""Options of a run as a TOML file: one table per stage, one key per field of its options.

What `to_toml` writes, `read_settings` reads back to equal options.
"""

import difflib
import tomllib
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from drl_meshgen.errors import MeshgenError
from drl_meshgen.pipeline import MeshOptions

T = TypeVar("T")


class SettingsError(MeshgenError):
    """A file of settings, or a setting in it, that cannot be used."""

    exit_code = 2


def read_settings(path: Path) -> MeshOptions:
    """Read options; what the file leaves out keeps its default.

    Raises `SettingsError` for a file that is not TOML, an unknown table or key and a value of another type.
    """
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path.name}: not a TOML file ({error})") from None
    except OSError as error:
        raise SettingsError(f"{path.name}: cannot be read ({error.strerror})") from None
    try:
        return _built(MeshOptions, data, "")
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
    if get_origin(hint) is tuple:
        items = get_args(hint)
        return f"a list of {_described(items[0])}" + ("" if items[-1] is Ellipsis else f", {len(items)} of them")
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    return names.get(hint, "a table")


def to_toml(options: MeshOptions) -> str:
    """Return all options as the text of a TOML file; those that are None are left out."""
    return "\n".join(_lines(options, "")).strip() + "\n"


def _lines(options: Any, name: str) -> list[str]:
    plain, tables = [f"[{name}]"] if name else [], []
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value):
            tables += ["", *_lines(value, f"{name}.{field.name}" if name else field.name)]
        elif value is not None:
            plain.append(f"{field.name} = {_literal(value)}")
    return plain + tables


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(_literal(item) for item in value)}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
