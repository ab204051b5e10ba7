"""What a run would do, and why: each stage's recipe beside the most similar one that the store has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from drl_meshgen.store.catalogue import Catalogue
from drl_meshgen.store.compare import Difference, differences, recipe_fields
from drl_meshgen.store.record import Record
from drl_meshgen.store.ref import ArtifactRef
from drl_meshgen.store.stage import Stage
from drl_meshgen.store.store import Store

_UNKNOWN = "0" * 64


class Fate(Enum):
    """What would become of a stage."""

    CACHED = "cached"
    RUN = "would run"
    OPEN = "would run unless what it is given turns out the same"


@dataclass(frozen=True)
class Step:
    """One stage of a plan."""

    stage: str
    fate: Fate
    key: str | None
    """Key of its recipe; None where what it is given is not known yet."""
    nearest: Record | None
    """The record whose recipe differs least, the one last asked for among equals; None where the stage never ran."""
    differences: tuple[Difference, ...]
    """Fields in which `nearest` differs; empty where it is cached, or damaged."""
    unknown: tuple[str, ...]
    """Inputs whose content is not known before they were computed."""


def plan(stages: Sequence[Stage[Any, Any]], options: Mapping[str, Any], store: Store) -> tuple[Step, ...]:
    """Return what `execute` would do with the same arguments, without doing it or leaving a trace.

    Raises `InputError` where there is no store or a file that belongs to a recipe cannot be read.
    """
    catalogue = Catalogue.of(store)
    refs: dict[str, ArtifactRef] = {}
    steps = []
    for stage in stages:
        own = options.get(stage.name)
        unknown = tuple(name for name in stage.inputs if name not in refs)
        blanks = {name: ArtifactRef(name, _UNKNOWN, {}) for name in unknown}
        recipe = stage.recipe({**refs, **blanks}, stage.options() if own is None else own)
        found = None if unknown else store.look_up(stage.name, recipe.key)
        if found is not None:
            refs[stage.name] = found
            record = store.record(stage.name, recipe.key)
            steps.append(Step(stage.name, Fate.CACHED, recipe.key, record, (), ()))
            continue
        present = recipe_fields(recipe)
        nearest, changed = _nearest(store, catalogue, stage.name, present, unknown)
        fate = Fate.OPEN if unknown and nearest is not None and not changed else Fate.RUN
        steps.append(Step(stage.name, fate, None if unknown else recipe.key, nearest, changed, unknown))
    return tuple(steps)


def _nearest(
    store: Store, catalogue: Catalogue, stage: str, present: Mapping[str, Any], unknown: Sequence[str]
) -> tuple[Record | None, tuple[Difference, ...]]:
    """Return the record of a stage whose known fields differ least from `present`, and those fields."""
    hidden = {f"inputs.{name}" for name in unknown}
    ranked = []
    for record in catalogue.records:
        if record.ref.stage == stage:
            changed = tuple(one for one in differences(record.recipe, present) if one.field not in hidden)
            used = store.record_path(stage, record.ref.key).stat().st_mtime_ns
            ranked.append((len(changed), -used, record.ref.key, record, changed))
    if not ranked:
        return None, ()
    *_, record, changed = min(ranked, key=lambda entry: entry[:3])
    return record, changed
