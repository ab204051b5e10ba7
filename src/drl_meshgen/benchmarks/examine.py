"""One surface through the pipeline and before an independent checker; whatever happens becomes a row."""

import contextlib
import io
import json
import math
import runpy
import sys
import tempfile
import warnings
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import pandas as pd

from drl_meshgen.benchmarks.columns import FIGURES
from drl_meshgen.codecs import FINAL
from drl_meshgen.errors import InputError, MeshgenError
from drl_meshgen.export import write_mesh, write_surface_ply
from drl_meshgen.mesh import BlockMesh, TriMesh
from drl_meshgen.models import load
from drl_meshgen.models.random_surface import random_surface
from drl_meshgen.pipeline import MeshOptions, run
from drl_meshgen.quality import Quality, gate
from drl_meshgen.quality.structure import boundary_loops
from drl_meshgen.store import Execution

SURFACE = "surface.ply"
SPECKS, FILLED = "leave out specks", "fill small holes"
"""Steps of the cleanup that change components and loops on purpose."""
FACTS = ("genus", "loops", "components", "limbs", "flaws")
"""What is known about the surface as it came; `limbs` and `flaws` of random surfaces only."""


class Status(Enum):
    """How a surface fared."""

    MESHED = "meshed"
    BELOW_GATE = "below the quality gate"
    DEFECTIVE = "defective"
    REFUSED = "refused"
    FAILED = "stage without result"
    CRASHED = "internal error"
    OUT_OF_MEMORY = "out of memory"
    OUT_OF_TIME = "out of time"
    DIED = "process died"


@dataclass(frozen=True)
class Case:
    """A surface and how it is to be meshed."""

    kind: str
    """Folder of the file, or `random`."""
    surface: str
    """Name in the table."""
    source: str
    """What the pipeline is given: path or model name."""
    seed: int | None
    """Seed of a random surface."""
    remesh: bool
    """Whether cleanup remeshes first."""
    target: int
    """Wanted number of quads."""

    @property
    def key(self) -> str:
        """Name of the case, unlike that of any other."""
        return f"{self.kind}/{self.surface} {'remeshed' if self.remesh else 'raw'} {self.target}"

    @property
    def head(self) -> dict[str, Any]:
        """First columns of its row."""
        return {
            "surface": self.surface,
            "kind": self.kind,
            "seed": self.seed,
            "remesh": self.remesh,
            "target": self.target,
        }

    @property
    def options(self) -> MeshOptions:
        """Options of the run: the defaults but for size and remeshing."""
        options = MeshOptions().sized(self.target)
        return replace(options, cleanup=replace(options.cleanup, remesh=self.remesh))


def facts(case: Case) -> dict[str, Any]:
    """Return genus, loops and components of the surface as it came; raises what reading it raises."""
    if case.seed is not None:
        made = random_surface(case.seed)
        return {name: getattr(made, name) for name in FACTS[:-1]} | {"flaws": ", ".join(made.flaws)}
    raw = load(case.source)
    t = TriMesh(raw.points, raw.triangles).topology
    loops, components = boundary_loops(t), t.components[0]
    return {"genus": (2 * components - t.euler - loops) // 2, "loops": loops, "components": components}


def refereed(script: Path, mesh: Path, surface: Path) -> tuple[str, ...]:
    """Return the defects an independent checker finds: `script MESH --surface SURFACE --json`.

    It runs inside this process, which has its libraries loaded already. Raises RuntimeError where it gives no verdict.
    """
    said, arguments = io.StringIO(), sys.argv
    try:
        sys.argv = [script.name, str(mesh), "--surface", str(surface), "--json"]
        with contextlib.redirect_stdout(said):
            runpy.run_path(str(script), run_name="__main__")
    except SystemExit:
        pass  # its status follows from what it says
    finally:
        sys.argv = arguments
    try:
        return tuple(json.loads(said.getvalue())["defects"])
    except (ValueError, KeyError):
        raise RuntimeError(f"{script.name} gave no verdict") from None


def _verdict(known: dict[str, Any], done: Execution, referee: Path | None) -> dict[str, Any]:
    """Return status, sentence, figures and defects of a finished run."""
    quality: Quality = done["quality"]
    m = quality.metrics
    found = _lost(known, done["cleanup"].audit, m)
    with tempfile.TemporaryDirectory() as folder:
        if referee is not None:
            mesh, surface = Path(folder, "mesh.vtu"), Path(folder, "surface.ply")
            write_mesh(mesh, done["smoothing"].mesh)
            write_surface_ply(surface, done["cleanup"].surface)
            found += [f"referee: {defect}" for defect in refereed(referee, mesh, surface)]
    found += list(quality.defects)
    below = [sentence for sentence in gate(quality) if sentence not in quality.defects]
    status = Status.DEFECTIVE if found else Status.BELOW_GATE if below else Status.MESHED
    return {
        "status": status.value,
        "sentence": "; ".join(found or below),
        **{name: m.get(name, math.nan) for name in FIGURES},
    }


def _lost(known: dict[str, Any], audit: pd.DataFrame, metrics: dict[str, float]) -> list[str]:
    """Compare the mesh with the surface as it came: what is missing without the audit saying so is a defect here."""
    changed = dict(zip(audit["step"], audit["count"], strict=True))
    specks, filled = (int(changed.get(step, 0)) for step in (SPECKS, FILLED))
    components, loops = known["components"] - specks, known["loops"] - filled
    wanted = {"components": components}
    if not specks:  # which may have had loops and handles
        wanted |= {"loops": loops, "euler": 2 * components - 2 * known["genus"] - loops}
    return [
        f"{name}: mesh {metrics[name]:g}, surface as it came {theirs}"
        for name, theirs in wanted.items()
        if metrics[name] != theirs
    ]


def examine(case: Case, referee: Path | None = None, keep: Path | None = None) -> dict[str, Any]:
    """Mesh one surface, check the result, return its row. Nothing is raised: a failure is a row with its cause.

    The files of the mesh are left in `keep`, in the folder of the case's key, for `kept`.
    """
    known: dict[str, Any] = {}
    try:
        known = facts(case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            done = run(case.source, case.options)
            if keep is not None:
                _keep(done, keep / case.key)
            verdict = _verdict(known, done, referee)
    except InputError as error:
        verdict = failure(Status.REFUSED, "; ".join(text for text in (error.defect, error.remedy) if text))
    except MeshgenError as error:
        verdict = failure(Status.FAILED, str(error))
    except MemoryError:
        verdict = failure(Status.OUT_OF_MEMORY, "")
    except Exception as error:  # noqa: BLE001 - the other surfaces shall have their turn
        first = (str(error).strip().splitlines() or [""])[0]
        verdict = failure(Status.CRASHED, f"{type(error).__name__}: {first}")
    return row(case, known, verdict)


def _keep(done: Execution, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    FINAL.write(done["smoothing"], folder)
    write_surface_ply(folder / SURFACE, done["cleanup"].surface)


def kept(case: Case, keep: Path) -> tuple[BlockMesh, TriMesh] | None:
    """Return mesh and cleaned surface of a case that `examine` kept; None where there is none."""
    folder = keep / case.key
    if not (folder / SURFACE).exists():
        return None
    raw = load(folder / SURFACE)
    return FINAL.read(folder).mesh, TriMesh(raw.points, raw.triangles)


def failure(status: Status, sentence: str) -> dict[str, Any]:
    """Return the end of a row without a mesh."""
    return {"status": status.value, "sentence": sentence} | dict.fromkeys(FIGURES, math.nan)


def row(case: Case, known: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """Return a row with every column: the case, the verdict, what is known of the surface."""
    return case.head | dict.fromkeys(FACTS) | known | verdict
