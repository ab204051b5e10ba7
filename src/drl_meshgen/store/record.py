"""Records: what a recipe gave, in a form that shows damage."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drl_meshgen.store.canonical import digest
from drl_meshgen.store.ref import ArtifactRef, Recipe

LARGEST_RECORD = 16_000_000
"""Bytes; a larger record is taken for damaged, unread."""


@dataclass(frozen=True)
class Record:
    """What the store knows of an artifact."""

    ref: ArtifactRef
    recipe: Recipe
    seconds: float
    """Wall-clock time of the computation, writing included."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock seconds of named parts of it."""
    made: Mapping[str, Any] = field(default_factory=dict)
    """Circumstances that the key leaves out: versions, options as they were given. Empty in records of old."""

    def to_json(self) -> str:
        """Return the record as text; a digest covers recipe and outputs, so times and circumstances stay outside."""
        hashed = {"recipe": self.recipe.to_json(), "outputs": dict(self.ref.outputs)}
        beside = {"seconds": self.seconds, "parts": dict(self.parts), "made": dict(self.made)}
        return json.dumps({**hashed, "digest": digest(hashed), **beside}, indent=1, sort_keys=True)


def parsed(stage: str, key: str, content: bytes) -> Record | None:
    """Return the record that `Record.to_json` wrote; None where it is damaged or not the one of this stage and key."""
    try:
        data = json.loads(content)
        given, outputs = data["recipe"], data["outputs"]
        ref = ArtifactRef(stage, key, outputs)
        recipe = Recipe(given["stage"], given["version"], given["source"], dict(given["inputs"]), given["options"])
        json.loads(recipe.options)
        sound = recipe.key == key == digest(given) and recipe.stage == stage
        sound = sound and data["digest"] == digest({"recipe": given, "outputs": outputs})
        parts = {name: float(seconds) for name, seconds in data["parts"].items()}
        record = Record(ref, recipe, float(data["seconds"]), parts, _circumstances(data.get("made", {})))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    return record if sound and outputs else None


def _circumstances(made: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is recorded beside the digest, where it has the form that is written; else raise ValueError."""
    json.loads(made.get("options", "null"))
    libraries = made.get("libraries", {})
    texts = [value for name, value in made.items() if name != "libraries"]
    if not all(isinstance(value, str) for value in (*texts, *libraries.values())):
        raise ValueError("circumstances are texts")
    return dict(made)
