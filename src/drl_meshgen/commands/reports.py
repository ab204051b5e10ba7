"""The report as an artifact: what it is made from, and how it is made once more."""

import json
from collections.abc import Mapping
from pathlib import Path

from drl_meshgen.errors import InputError
from drl_meshgen.pipeline import COMPARED_STAGES
from drl_meshgen.report import build_report, model_run
from drl_meshgen.store import ArtifactRef, Recipe, Store, reopen
from drl_meshgen.store.catalogue import SHORT, Catalogue
from drl_meshgen.store.record import Record
from drl_meshgen.store.reproduce import Reproduction, inputs_of, judged
from drl_meshgen.store.source import source_digest

STAGE = "report"
VERSION = 1
Surfaces = Mapping[str, Mapping[str, ArtifactRef]]
"""Artifacts of all stages by name, for each surface by name, in the order of the report."""


def recipe(surfaces: Surfaces) -> Recipe:
    """Return what the report on surfaces depends on."""
    inputs = {f"{name}/{stage}": ref for name, refs in surfaces.items() for stage, ref in refs.items()}
    return Recipe.of(STAGE, VERSION, source_digest(("drl_meshgen.report",)), inputs, {"surfaces": list(surfaces)})


def write(surfaces: Surfaces, store: Store, folder: Path) -> None:
    """Write tables, pictures and the page that shows them to a folder."""
    runs = {name: reopen(COMPARED_STAGES, refs, store) for name, refs in surfaces.items()}
    build_report([model_run(name, run) for name, run in runs.items()], folder)


def reproduce(catalogue: Catalogue, record: Record, store: Store) -> Reproduction:
    """Make a report again from the artifacts that it shows, as `store.reproduce` does a stage's.

    Raises `InputError` where any of them is gone.
    """
    found = inputs_of(catalogue, record, store)
    names = json.loads(record.recipe.options)["surfaces"]
    surfaces: dict[str, dict[str, ArtifactRef]] = {
        name: {stage.name: found[key] for stage in COMPARED_STAGES if (key := f"{name}/{stage.name}") in found}
        for name in names
    }
    present = recipe(surfaces)
    if present.inputs != record.recipe.inputs:
        raise InputError(record.ref.key[:SHORT], "it shows artifacts that this version does not know")
    return judged(record, present, store, lambda folder: write(surfaces, store, folder))
