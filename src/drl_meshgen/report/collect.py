"""From a finished run of the pipeline to what the report shows of it."""

import numpy as np
import pandas as pd

from drl_meshgen.baselines import Comparison
from drl_meshgen.quality import gate, quality_row
from drl_meshgen.report.inputs import OURS, ModelRun
from drl_meshgen.store import Execution

COMPARISON = "comparison"
NOT_MESHING = ("model", COMPARISON, "quality")
"""Stages whose time is no part of ours in the table: getting the model and judging meshes."""


def model_run(name: str, done: Execution) -> ModelRun:
    """Return what the report shows of one surface, with rivals where the run had a comparison."""
    parts, quality = done["partition"], done["quality"]
    cut = parts.surface.mesh
    timings = {timing.stage: timing for timing in done.timings}
    seconds = sum(timing.computed for timing in done.timings if timing.stage not in NOT_MESHING)
    missed = gate(quality)
    rows = pd.DataFrame([quality_row(OURS, quality, seconds, ok=not missed, cause="; ".join(missed))])
    rivals = Comparison.none()
    if COMPARISON in timings:
        rivals = done[COMPARISON]
        theirs = rivals.rows["method"].map(timings[COMPARISON].parts).astype(float)
        rows = pd.concat([rows, rivals.rows.assign(seconds=theirs)], ignore_index=True)
    return ModelRun(
        name,
        done["cleanup"].surface,
        cut,
        parts.surface.depth,
        parts.region,
        [cut.vertices[np.r_[c.vertices, c.vertices[:1]]] for c in parts.curves if not c.is_boundary],
        done["smoothing"].mesh,
        rows,
        pd.DataFrame([{"stage": t.stage, "seconds": t.computed} for t in done.timings if t.stage != COMPARISON]),
        rivals.meshes,
        rivals.triangles,
    )
