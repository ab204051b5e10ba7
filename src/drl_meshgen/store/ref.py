"""References to stored artifacts, and the recipes whose digest is their key."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from drl_meshgen.store.canonical import canonical, digest

DIGEST = re.compile(r"[0-9a-f]{64}")
_STAGE = re.compile(r"[a-z][a-z0-9_-]{0,63}")
_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,127}")


def checked_digest(text: object) -> str:
    """Return a SHA-256 in hexadecimal unchanged; raises ValueError for anything else."""
    if not isinstance(text, str) or not DIGEST.fullmatch(text):
        raise ValueError(f"{text!r} is not a SHA-256 digest")
    return text


def checked_stage(name: object) -> str:
    """Return a stage name unchanged; raises ValueError where it is not one lower case word."""
    if not isinstance(name, str) or not _STAGE.fullmatch(name):
        raise ValueError(f"{name!r} is not a stage name")
    return name


def checked_output(name: object) -> str:
    """Return the name of an output file unchanged; raises ValueError where it could lead out of its folder.

    Names are relative paths with `/`; parts start with a letter, digit or underscore, so `..` and hidden files are out.
    """
    if not isinstance(name, str) or not all(_PART.fullmatch(part) for part in name.split("/")):
        raise ValueError(f"{name!r} is not a name an output may have")
    return name


@dataclass(frozen=True)
class ArtifactRef:
    """What a stage left in the store: small enough to hand between tasks as JSON."""

    stage: str
    key: str
    """Digest of the recipe, see `Recipe`."""
    outputs: Mapping[str, str]
    """SHA-256 of each output file by name."""

    def __post_init__(self) -> None:
        checked_stage(self.stage)
        checked_digest(self.key)
        clean = {checked_output(name): checked_digest(self.outputs[name]) for name in sorted(self.outputs)}
        object.__setattr__(self, "outputs", clean)

    def __hash__(self) -> int:
        return hash((self.stage, self.key))

    @cached_property
    def digest(self) -> str:
        """SHA-256 over names and contents: what the keys of later stages depend on."""
        return digest(self.outputs)

    def to_json(self) -> str:
        """Return the reference as JSON text."""
        return json.dumps({"stage": self.stage, "key": self.key, "outputs": dict(self.outputs)})

    @classmethod
    def from_json(cls, text: str) -> "ArtifactRef":
        """Return the reference that `to_json` wrote; raises ValueError, KeyError or TypeError for other text."""
        data = json.loads(text)
        return cls(data["stage"], data["key"], dict(data["outputs"]))


@dataclass(frozen=True)
class Recipe:
    """Everything a stored result depends on; its digest is the key."""

    stage: str
    version: int
    source: str
    """Digest of the source code, see `source_digest`."""
    inputs: Mapping[str, str]
    """Digest of the content of each upstream artifact, so that a change which leaves the content alone stops here."""
    options: str
    """Canonical JSON of the options."""

    @classmethod
    def of(cls, stage: str, version: int, source: str, inputs: Mapping[str, ArtifactRef], options: object) -> "Recipe":
        """Return the recipe of a stage applied to artifacts with options."""
        upstream = {name: inputs[name].digest for name in sorted(inputs)}
        return cls(checked_stage(stage), version, source, upstream, canonical(options))

    @cached_property
    def key(self) -> str:
        """SHA-256 of the recipe."""
        return digest(self.to_json())

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as plain JSON data."""
        return {
            "stage": self.stage,
            "version": self.version,
            "source": self.source,
            "inputs": dict(self.inputs),
            "options": self.options,
        }
