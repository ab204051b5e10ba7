"""Task that makes the report of a run, cached like a stage: the same artifacts give the same page."""

from collections.abc import Mapping
from typing import Any

from drl_meshgen.commands import reports
from drl_meshgen.store import ArtifactRef, Recipe, Store
from tasks.stage import Refs, stored_task


def _opened(surfaces: Mapping[str, Refs]) -> dict[str, dict[str, ArtifactRef]]:
    return {name: {stage: ArtifactRef.from_json(ref) for stage, ref in refs.items()} for name, refs in surfaces.items()}


def _recipe(parameters: dict[str, Any]) -> Recipe:
    return reports.recipe(_opened(parameters["surfaces"]))


def _run(surfaces: Mapping[str, Refs], store: str) -> str:
    """Write tables, pictures and the page that shows them."""
    place, known = Store(store), _opened(surfaces)
    return place.run(reports.recipe(known), lambda folder: reports.write(known, place, folder)).to_json()


report = stored_task(
    _run, _recipe, name=reports.STAGE, run_name=reports.STAGE, version=reports.VERSION, description=_run.__doc__
)
