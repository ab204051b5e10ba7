"""Content-addressed artifacts: a stage is computed once for the same inputs, options and code."""

from drl_meshgen.store.ref import ArtifactRef, Recipe
from drl_meshgen.store.stage import (
    Execution,
    Progress,
    Stage,
    Timing,
    ancestors,
    execute,
    load,
    memoised,
    reopen,
    stored,
)
from drl_meshgen.store.store import DamagedArtifactError, Store

__all__ = [
    "ArtifactRef",
    "DamagedArtifactError",
    "Execution",
    "Progress",
    "Recipe",
    "Stage",
    "Store",
    "Timing",
    "ancestors",
    "execute",
    "load",
    "memoised",
    "reopen",
    "stored",
]
