"""Running one rival: a process of its own with a time limit, tuned to the wanted number of quads."""

import importlib.util
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.deviation import area_samples, as_triangles
from drl_meshgen.quality.structure import boundary_loops


class Method(Enum):
    """Which mesher, and what it is asked for. The value is the name in tables."""

    QUASI_STRUCTURED = "Gmsh quasi-structured"
    BLOSSOM = "Gmsh blossom"
    BLOSSOM_SUBDIVIDED = "Gmsh blossom, subdivided"
    TRANSFINITE = "Gmsh transfinite"
    QUADRIFLOW = "QuadriFlow"

    @property
    def key(self) -> str:
        """Short name, fit for file names."""
        return self.name.lower().replace("_", "-")


class RivalOutcome(Enum):
    """How a rival's run ended. The value is the sentence for the table."""

    MESHED = "meshed the whole surface"
    INCOMPLETE = "part of the surface is missing from the mesh"
    EMPTY = "made no quad"
    CRASHED = "stopped with an error"
    TIMED_OUT = "ran out of time"
    NOT_INSTALLED = "is not installed; pip install 'drl-meshgen[bench]' does it"
    NOT_APPLICABLE = "needs a surface with one boundary loop and no handle"


@dataclass(frozen=True)
class RivalOptions:
    """How rivals are run."""

    methods: tuple[str, ...] = tuple(method.key for method in Method if method is not Method.QUADRIFLOW)
    """Which methods run: quasi-structured, blossom, blossom-subdivided, transfinite (all Gmsh), quadriflow."""
    timeout: float = 90.0
    """Time limit of one method, all its attempts together, seconds."""
    corrections: int = 2
    """How often the size may be corrected to come closer to the wanted number of quads."""
    tolerance: float = 0.1
    """A count within this share of the wanted one is close enough."""
    missing: float = 0.05
    """A surface point farther than this from the mesh counts as missing, in bounding-box diagonals."""

    def __post_init__(self) -> None:
        known = [method.key for method in Method]
        if unknown := [key for key in self.methods if key not in known]:
            raise ValueError(f"{unknown[0]!r} is not a method; known are {', '.join(known)}")

    @property
    def chosen(self) -> tuple[Method, ...]:
        """The methods, in the order of the options."""
        return tuple(Method[key.upper().replace("-", "_")] for key in self.methods)


@dataclass(frozen=True, eq=False)
class Rival:
    """What a rival made of a surface."""

    method: Method
    outcome: RivalOutcome
    detail: str = ""
    """What the mesher said last, or the figure behind the outcome."""
    seconds: float = np.nan
    """Wall time from surface to mesh inside the mesher, of the run whose mesh this is."""
    mesh: QuadMesh | None = None
    triangles: Int[np.ndarray, "t 3"] | None = None
    """Faces that are not quads."""


# Run by path: importing the package would cost more than a small mesh.
_GMSH, _QUADRIFLOW = (Path(__file__).with_name(f"{name}_worker.py") for name in ("gmsh", "quadriflow"))
# Quads made per square of the target edge length, measured on a hemisphere; the first guess of the size.
_QUADS_PER_SQUARE = {Method.QUASI_STRUCTURED: 3.9, Method.BLOSSOM_SUBDIVIDED: 4.2, Method.QUADRIFLOW: 1.25}
# Seconds that the second try may take where the first ended sooner.
_SECOND_TRY = 20.0


def _four_sides(surface: TriMesh, loop: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " 4"]]:
    """Cut the loop in four: at its four sharp corners if it has just these, else in quarters of its length.

    Returns the loop, started at a corner, and the positions of the corners in it.
    """
    p = surface.vertices[loop]
    ahead, behind = np.roll(p, -1, axis=0) - p, np.roll(p, 1, axis=0) - p
    length = np.linalg.norm(ahead, axis=1)
    cosine = np.einsum("ij,ij->i", ahead, behind) / np.maximum(length * np.roll(length, 1), np.finfo(float).tiny)
    sharp = np.nonzero(cosine > np.cos(np.radians(135)))[0]
    if len(sharp) == 4:
        return np.roll(loop, -sharp[0]), sharp - sharp[0]
    position = np.cumsum(length) - length
    return loop, np.abs(position - np.arange(4)[:, None] / 4 * length.sum()).argmin(axis=1)


def _attempt(surface: TriMesh, method: Method, size: float, timeout: float, *, split: bool) -> Rival:
    loop, corners = np.zeros(0, np.int64), np.zeros(4, np.int64)
    if method is Method.TRANSFINITE:
        loop, corners = _four_sides(surface, surface.topology.loops[0])
    with tempfile.TemporaryDirectory() as folder:
        job, out = Path(folder, "job.npz"), Path(folder, "out.npz")
        np.savez(
            job,
            vertices=surface.vertices,
            triangles=surface.triangles,
            loop=loop,
            corners=corners,
            method=method.key,
            size=size,
            split=split,
            limit=timeout,
        )
        worker = _QUADRIFLOW if method is Method.QUADRIFLOW else _GMSH
        command = [sys.executable, "-P", str(worker), str(job), str(out)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)  # noqa: S603
        except subprocess.TimeoutExpired:
            return Rival(method, RivalOutcome.TIMED_OUT)
        if done.returncode or not out.is_file():
            said = (done.stderr.strip().splitlines() or [""])[-1]
            return Rival(method, RivalOutcome.CRASHED, said or f"exit status {done.returncode}")
        with np.load(out) as made:
            mesh = QuadMesh(made["points"], made["quads"])
            triangles, seconds = made["triangles"], float(made["seconds"])
    if not len(mesh.quads):
        return Rival(method, RivalOutcome.EMPTY, seconds=seconds)
    return Rival(method, RivalOutcome.MESHED, seconds=seconds, mesh=_oriented(mesh, surface), triangles=triangles)


def _oriented(mesh: QuadMesh, surface: TriMesh) -> QuadMesh:
    """Return the mesh wound as the surface is."""
    corners = mesh.points[mesh.quads]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    under = surface.normals[TriangleSearch(surface.corners)(corners.mean(axis=1))[1]]
    against = np.median(np.einsum("ij,ij->i", normals, under)) < 0
    return QuadMesh(mesh.points, mesh.quads[:, ::-1]) if against else mesh


def _checked(rival: Rival, surface: TriMesh, missing: float) -> Rival:
    """Turn a mesh that leaves out part of the surface into `INCOMPLETE`; the mesh stays for the pictures."""
    if rival.mesh is None or rival.triangles is None:
        return rival
    faces = np.concatenate([as_triangles(rival.mesh), rival.triangles])
    far = TriangleSearch(rival.mesh.points[faces])(area_samples(surface.corners, 4000))[0].max() / surface.diagonal
    if far <= missing:
        return rival
    detail = f"{far:.2f} diagonals from the mesh at worst"
    return Rival(rival.method, RivalOutcome.INCOMPLETE, detail, rival.seconds, rival.mesh, rival.triangles)


def run_rival(surface: TriMesh, method: Method, target_quads: int, options: RivalOptions | None = None) -> Rival:
    """Mesh the surface with one of the methods at about `target_quads` quads.

    The surface is given to Gmsh as one patch first and, where that fails, cut in patches by Gmsh itself; QuadriFlow
    solves by maximum flow first, then by minimum-cost flow. The second try may take as long as the first. Nothing is
    raised for a rival's failure: it is the outcome. The run nearest to the wanted count among those that ended well is
    returned.
    """
    options = options or RivalOptions()
    start = time.monotonic()
    t = surface.topology
    if method is Method.TRANSFINITE and (t.euler != 1 or boundary_loops(t) != 1):
        return Rival(method, RivalOutcome.NOT_APPLICABLE)
    if method is Method.QUADRIFLOW and importlib.util.find_spec("pyQuadriFlow") is None:
        return Rival(method, RivalOutcome.NOT_INSTALLED)

    def attempt(size: float, *, split: bool, seconds: float = np.inf) -> Rival:
        left = min(seconds, start + options.timeout - time.monotonic())
        if left <= 0:
            return Rival(method, RivalOutcome.TIMED_OUT)
        return _checked(_attempt(surface, method, size, left, split=split), surface, options.missing)

    size = float(np.sqrt(surface.area / target_quads * _QUADS_PER_SQUARE.get(method, 1.0)))
    best = attempt(size, split=False)
    if best.outcome is RivalOutcome.TIMED_OUT:
        return replace(best, detail=f"limit {options.timeout:g} s")
    best = _tuned(best, size, target_quads, options, partial(attempt, split=False))
    if best.outcome is RivalOutcome.MESHED or method is Method.TRANSFINITE:
        return best
    second = attempt(size, split=True, seconds=max(_SECOND_TRY, time.monotonic() - start))
    second = _tuned(second, size, target_quads, options, partial(attempt, split=True))
    better = second.outcome is RivalOutcome.MESHED or (best.mesh is None and second.mesh is not None)
    return second if better else best


def _worth_tuning(rival: Rival) -> bool:
    """Tell whether a run is to be corrected: it is whole, or lost limbs as QuadriFlow does where it is coarse."""
    whole = rival.outcome is RivalOutcome.MESHED
    return whole or (rival.method is Method.QUADRIFLOW and rival.outcome is RivalOutcome.INCOMPLETE)


def _tuned(
    best: Rival, size: float, target_quads: int, options: RivalOptions, attempt: Callable[[float], Rival]
) -> Rival:
    """Correct the size until the count fits; keep the nearest run that is worth it. Others come back as they are."""
    if not _worth_tuning(best):
        return best
    nearest = count = _count(best)
    for _ in range(options.corrections):
        if abs(count / target_quads - 1) <= options.tolerance:
            break
        size *= np.sqrt(count / target_quads)
        latest = attempt(size)
        if not _worth_tuning(latest):
            break
        count = _count(latest)
        if abs(np.log(count / target_quads)) < abs(np.log(nearest / target_quads)):
            best, nearest = latest, count
    return best


def _count(rival: Rival) -> int:
    return 0 if rival.mesh is None else len(rival.mesh.quads)
