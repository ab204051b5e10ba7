"""Options as objects again, from the canonical text that records keep."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints


def restored(hint: Any, value: Any) -> Any:
    """Return an object of the annotated type from the JSON data of its `canonical` form.

    Fields that the data lack get their default. Raises ValueError, KeyError or TypeError where they do not fit.
    """
    if get_origin(hint) in (Union, UnionType):
        if value is None:
            return None
        kinds = [kind for kind in get_args(hint) if kind is not NoneType]
        return restored(kinds[0], value)
    if isinstance(hint, type) and is_dataclass(hint):
        return _dataclass(hint, value)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint[value["name"]]
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        if kinds[-1] is Ellipsis:
            kinds = kinds[:1] * len(value)
        return tuple(restored(kind, item) for kind, item in zip(kinds, value, strict=True))
    return float(value) if hint is float else value


def _dataclass(kind: type, value: Any) -> Any:
    name, data = value if isinstance(value, list) else (value["type"], value)
    if name != kind.__qualname__ or not isinstance(data, Mapping):
        raise ValueError(f"{name} is not {kind.__qualname__}")
    own = {key: item for key, item in data.items() if isinstance(value, list) or key != "type"}
    if strange := sorted(set(own) - {field.name for field in fields(kind)}):
        raise ValueError(f"{kind.__qualname__} has no {', '.join(strange)}")
    hints = get_type_hints(kind)
    return kind(**{key: restored(hints[key], item) for key, item in own.items()})
