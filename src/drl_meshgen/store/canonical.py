"""One text for one value, and digests: what cache keys are made of."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path

import numpy as np


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        shown = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {"type": type(value).__qualname__, **shown} if "type" not in shown else [type(value).__qualname__, shown]
    if isinstance(value, Enum):
        return {"type": type(value).__qualname__, "name": value.name}
    if isinstance(value, np.generic):
        return _plain(value.item())
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Mapping):
        if not all(isinstance(name, str) for name in value):
            raise TypeError("only mappings with text keys have a canonical form")
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no canonical form; options are made of numbers, text and dataclasses")


def canonical(value: object) -> str:
    """Return the canonical JSON of a value made of dataclasses, enums, mappings, sequences, text and numbers.

    Keys are sorted, floats are written by `repr` (shortest text that reads back the same), dataclasses and enums carry
    their type's name. Raises TypeError for anything else (paths and arrays on purpose: one depends on the machine, the
    other belongs into an artifact) and ValueError for NaN and infinity.
    """
    return json.dumps(_plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def digest(value: object) -> str:
    """Return the SHA-256 of `canonical(value)` in hexadecimal."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content in hexadecimal."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
