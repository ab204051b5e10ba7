"""All rivals on one surface, measured by the same code as our own mesh."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Int

from drl_meshgen.baselines.runner import Rival, RivalOptions, RivalOutcome, run_rival
from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.progress import counter
from drl_meshgen.quality import measure, quality_row

AT_ONCE = 2
"""Rivals that run at the same time, each in one process with one thread."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """What the rivals made of a surface. Rivals are called as in the column `method` of `rows`."""

    rows: pd.DataFrame
    """One row per rival as `quality_row` makes it, without times."""
    meshes: Mapping[str, QuadMesh]
    """Quads of each rival that made any."""
    triangles: Mapping[str, Int[np.ndarray, "t 3"]]
    """Other faces of the same rivals."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time of each of these rivals, from surface to mesh; empty when read back from files."""

    @classmethod
    def none(cls) -> "Comparison":
        """Return a comparison without rivals."""
        return cls(pd.DataFrame({"method": pd.Series([], dtype=str)}), {}, {})


def rival_row(rival: Rival, surface: TriMesh) -> dict[str, str | float | bool]:
    """Return the row of the quality table for one rival; its cause says what went wrong."""
    ok = rival.outcome is RivalOutcome.MESHED
    cause = "" if ok else rival.outcome.value + (f" ({rival.detail})" if rival.detail else "")
    quality = None if rival.mesh is None else measure(rival.mesh, surface, triangles=rival.triangles)
    row = quality_row(rival.method.value, quality, ok=ok, cause=cause)
    return {name: figure for name, figure in row.items() if name != "seconds"}


def compare(surface: TriMesh, target_quads: int, options: RivalOptions | None = None) -> Comparison:
    """Run the rivals that the options name, two at a time, each at about `target_quads` quads."""
    options = options or RivalOptions()
    with ThreadPoolExecutor(AT_ONCE) as pool:
        jobs = [pool.submit(run_rival, surface, method, target_quads, options) for method in options.chosen]
        done = counter("rivals done", len(jobs))
        for _ in as_completed(jobs):
            done()
        rivals = [job.result() for job in jobs]
    made = {rival.method.value: rival for rival in rivals if rival.mesh is not None}
    return Comparison(
        pd.DataFrame([rival_row(rival, surface) for rival in rivals]),
        {name: rival.mesh for name, rival in made.items() if rival.mesh is not None},
        {name: rival.triangles for name, rival in made.items() if rival.triangles is not None},
        {name: rival.seconds for name, rival in made.items()},
    )
