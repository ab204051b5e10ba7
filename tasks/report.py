"""Task that makes the report of a run, cached like a stage: the same artifacts give the same page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drl_meshgen.pipeline import COMPARED_STAGES
from drl_meshgen.report import build_report, model_run
from drl_meshgen.store import ArtifactRef, Recipe, Store, reopen
from drl_meshgen.store.source import source_digest
from tasks.stage import Refs, stored_task

VERSION = 1


def _opened(surfaces: Mapping[str, Refs]) -> dict[str, dict[str, ArtifactRef]]:
    return {name: {stage: ArtifactRef.from_json(ref) for stage, ref in refs.items()} for name, refs in surfaces.items()}


def _recipe(parameters: dict[str, Any]) -> Recipe:
    known = _opened(parameters["surfaces"])
    inputs = {f"{name}/{stage}": ref for name, refs in known.items() for stage, ref in refs.items()}
    return Recipe.of("report", VERSION, source_digest(("drl_meshgen.report",)), inputs, {"surfaces": list(known)})


def _run(surfaces: Mapping[str, Refs], store: str) -> str:
    """Write tables, pictures and the page that shows them."""
    place = Store(store)

    def compute(folder: Path) -> None:
        runs = {name: reopen(COMPARED_STAGES, refs, place) for name, refs in _opened(surfaces).items()}
        build_report([model_run(name, run) for name, run in runs.items()], folder)

    return place.run(_recipe({"surfaces": surfaces}), compute).to_json()


report = stored_task(_run, _recipe, name="report", run_name="report", version=VERSION, description=_run.__doc__)
