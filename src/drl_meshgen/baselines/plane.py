"""Gmsh's methods on one plane domain, its boundary nodes kept: a process of its own with a time limit."""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.baselines.runner import RivalOutcome

_WORKER = Path(__file__).with_name("gmsh_plane_worker.py")


class PlaneMethod(Enum):
    """What Gmsh is asked for. The value is the name in tables.

    All keep the number of boundary nodes. Gmsh spaces them evenly, along each pair of edges (transfinite: along each
    side), so that nodes move a little where neighbouring edges differ in length.
    """

    QUASI_STRUCTURED = "Gmsh quasi-structured"
    BLOSSOM = "Gmsh blossom, full quads"
    TRANSFINITE = "Gmsh transfinite"

    @property
    def key(self) -> str:
        """Name as the worker knows it."""
        return self.name.lower().replace("_", "-")


@dataclass(frozen=True, eq=False)
class PlaneRival:
    """What a method made of a domain."""

    outcome: RivalOutcome
    points: Float[np.ndarray, "p 2"]
    quads: Int[np.ndarray, "m 4"]
    triangles: int = 0
    """Faces that are not quads (count); 0 is what all methods promise."""
    seconds: float = np.nan
    """Wall time inside the mesher."""


_NOTHING = np.zeros((0, 2)), np.zeros((0, 4), np.int64)


def plane_rivals(
    nodes: Float[np.ndarray, "l 2"],
    corners: Int[np.ndarray, "4"],
    methods: Sequence[PlaneMethod] = tuple(PlaneMethod),
    timeout: float = 60.0,
) -> dict[PlaneMethod, PlaneRival]:
    """Mesh an anti-clockwise polygon with an even number of nodes by each method.

    `corners` are the four nodes between which transfinite meshes span; opposite sides need the same number of cells.
    The methods have `timeout` seconds together. Nothing is raised for a failure: it is the outcome.
    """
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder, "job.npz")
        names = np.array([method.key for method in methods])
        np.savez(job, nodes=nodes, corners=np.sort(corners), methods=names, limit=timeout)
        command = [sys.executable, "-P", str(_WORKER), str(job), folder]
        try:
            subprocess.run(command, capture_output=True, timeout=timeout, check=False)  # noqa: S603 - our own worker
            missing = RivalOutcome.CRASHED
        except subprocess.TimeoutExpired:
            missing = RivalOutcome.TIMED_OUT
        return {method: _made(Path(folder, f"{method.key}.npz"), missing) for method in methods}


def _made(path: Path, missing: RivalOutcome) -> PlaneRival:
    if not path.is_file():
        return PlaneRival(missing, *_NOTHING)
    with np.load(path) as made:
        points, quads = made["points"], made["quads"]
        triangles, seconds = len(made["triangles"]), float(made["seconds"])
    if not len(quads):
        return PlaneRival(RivalOutcome.EMPTY, points, quads, triangles, seconds)
    diagonal = points[quads[:, 2:]] - points[quads[:, :2]]
    area = diagonal[:, 0, 0] * diagonal[:, 1, 1] - diagonal[:, 0, 1] * diagonal[:, 1, 0]
    if area.sum() < 0:  # Gmsh winds some meshes clockwise as a whole
        quads = quads[:, ::-1].copy()
    return PlaneRival(RivalOutcome.MESHED, points, quads, triangles, seconds)
