"""Task that makes the report of a run, cached like a stage: the same artifacts give the same page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from drl_meshgen.pipeline import STAGES
from drl_meshgen.quality import gate, quality_row
from drl_meshgen.report import OURS, ModelRun, build_report
from drl_meshgen.store import ArtifactRef, Execution, Recipe, Store, reopen
from drl_meshgen.store.source import source_digest
from tasks.stage import Refs, stored_task

VERSION = 1
NOT_MESHING = ("model", "comparison", "quality")
"""Stages whose time is no part of ours in the table: getting the model and judging meshes."""


def model_run(name: str, done: Execution) -> ModelRun:
    """Return what the report shows of one surface."""
    parts, quality = done["partition"], done["quality"]
    cut = parts.surface.mesh
    seconds = sum(timing.computed for timing in done.timings if timing.stage not in NOT_MESHING)
    missed = gate(quality)
    return ModelRun(
        name,
        done["cleanup"].surface,
        cut,
        parts.surface.depth,
        parts.region,
        [cut.vertices[np.r_[c.vertices, c.vertices[:1]]] for c in parts.curves if not c.is_boundary],
        done["smoothing"].mesh,
        pd.DataFrame([quality_row(OURS, quality, seconds, ok=not missed, cause="; ".join(missed))]),
        pd.DataFrame([{"stage": timing.stage, "seconds": timing.computed} for timing in done.timings]),
    )


def _opened(surfaces: Mapping[str, Refs]) -> dict[str, dict[str, ArtifactRef]]:
    return {name: {stage: ArtifactRef.from_json(ref) for stage, ref in refs.items()} for name, refs in surfaces.items()}


def _recipe(parameters: dict[str, Any]) -> Recipe:
    known = _opened(parameters["surfaces"])
    inputs = {f"{name}/{stage}": ref for name, refs in known.items() for stage, ref in refs.items()}
    source = source_digest(("drl_meshgen.report", "drl_meshgen.quality"))
    return Recipe.of("report", VERSION, source, inputs, {"surfaces": list(known)})


def _run(surfaces: Mapping[str, Refs], store: str) -> str:
    """Write tables, pictures and the page that shows them."""
    place = Store(store)

    def compute(folder: Path) -> None:
        known = _opened(surfaces)
        build_report([model_run(name, reopen(STAGES, refs, place)) for name, refs in known.items()], folder)

    return place.run(_recipe({"surfaces": surfaces}), compute).to_json()


report = stored_task(_run, _recipe, name="report", run_name="report", version=VERSION, description=_run.__doc__)
