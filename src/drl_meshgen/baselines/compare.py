"""All rivals on one surface, measured by the same code as our own mesh."""

from collections.abc import Sequence

import pandas as pd

from drl_meshgen.baselines.runner import Method, Rival, RivalOptions, RivalOutcome, run_rival
from drl_meshgen.mesh import TriMesh
from drl_meshgen.quality import measure, quality_row


def rival_row(rival: Rival, surface: TriMesh) -> dict[str, str | float | bool]:
    """Return the row of the quality table for one rival; its cause says what went wrong."""
    ok = rival.outcome is RivalOutcome.MESHED
    cause = "" if ok else rival.outcome.value + (f" ({rival.detail})" if rival.detail else "")
    quality = None if rival.mesh is None else measure(rival.mesh, surface, triangles=rival.triangles)
    return quality_row(rival.method.value, quality, rival.seconds, ok=ok, cause=cause)


def compare(
    surface: TriMesh, target_quads: int, methods: Sequence[Method] = tuple(Method), options: RivalOptions | None = None
) -> tuple[pd.DataFrame, dict[str, Rival]]:
    """Run the rivals one after the other; return the table, one row per method, and the rivals by table name."""
    rivals = {m.value: run_rival(surface, m, target_quads, options) for m in methods}
    return pd.DataFrame([rival_row(r, surface) for r in rivals.values()]), rivals
