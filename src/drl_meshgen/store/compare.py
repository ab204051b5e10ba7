"""Recipes field by field."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drl_meshgen.store.ref import Recipe


@dataclass(frozen=True)
class Difference:
    """A field of a recipe that differs."""

    field: str
    """Dotted name: `options.target_quads`, `inputs.partition`, `source`, `version`."""
    former: Any
    """Value in the record; None where it has no such field."""
    present: Any
    """Value now; None where there is no such field now, or where it is not known yet."""


def flattened(value: object, prefix: str) -> dict[str, Any]:
    """Return the leaves of JSON data by dotted name; names of types and empty lists are leaves too."""
    if isinstance(value, Mapping) and value:
        items = {f"{prefix}.{name}": item for name, item in value.items()}
    elif isinstance(value, list) and value and any(isinstance(item, (list, Mapping)) for item in value):
        items = {f"{prefix}[{place}]": item for place, item in enumerate(value)}
    else:
        return {prefix: value}
    return {name: leaf for key, item in items.items() for name, leaf in flattened(item, key).items()}


def recipe_fields(recipe: Recipe) -> dict[str, Any]:
    """Return everything a key depends on, but the stage, by dotted name."""
    data = recipe.to_json()
    options = flattened(json.loads(recipe.options), "options")
    inputs = {f"inputs.{name}": content for name, content in recipe.inputs.items()}
    return {"version": data["version"], "source": data["source"], **inputs, **options}


def differences(former: Recipe, present: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Return the fields in which a recorded recipe differs from `present` (see `recipe_fields`), in its order."""
    old = recipe_fields(former)
    names = [*present, *(name for name in old if name not in present)]
    return tuple(
        Difference(name, old.get(name), present.get(name)) for name in names if old.get(name) != present.get(name)
    )
