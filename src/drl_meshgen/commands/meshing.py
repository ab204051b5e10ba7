"""The `mesh` command: one input after another, a verdict for each."""

import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from drl_meshgen import pipeline
from drl_meshgen.commands.layout_file import steered
from drl_meshgen.commands.output import (
    DEFECT,
    can_draw,
    complete,
    folder_names,
    write_defect,
    write_layout_file,
    write_pictures,
    write_results,
    write_rivals,
    zone_table,
)
from drl_meshgen.errors import BELOW_GATE, FINE, INTERNAL, InputError, MeshgenError, disk_sentence, overall
from drl_meshgen.models import is_generated
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.quality import Quality, gate
from drl_meshgen.smoothing.final import FinalMesh
from drl_meshgen.store import Execution, Store
from drl_meshgen.store import Progress as Step


@dataclass(frozen=True)
class Request:
    """What to mesh and what to write."""

    sources: Sequence[str]
    """Model names and files."""
    out: Path
    """Folder that gets one folder per input."""
    options: MeshOptions
    """Options of all stages."""
    triangles: int
    """Size of generated models (count)."""
    store: Store | None = None
    """Where stage results are kept and looked up; None: nowhere."""
    pictures: bool = True
    """Write pictures too."""
    compare: bool = False
    """Run other meshers on the same surfaces too."""
    timings: bool = False
    """Print how long each stage took."""
    debug: bool = False
    """Show the traceback of an unexpected error."""
    layout: Path | None = None
    """File of an edited layout that the mesh gets."""


def mesh_all(request: Request) -> int:
    """Mesh all inputs and return the exit code; a failed input does not stop the others.

    A single input gives its own code. Of several, 5 where any failed, else 4 where any is below the gate.
    """
    if request.pictures and not can_draw():
        typer.echo("warning: no pictures, because the library EGL is not installed (libegl1)", err=True)
        request = replace(request, pictures=False)
    return for_all(request, _mesh_one)


def for_all(request: Request, one: Callable[[Request, str, str], int]) -> int:
    """Run `one(request, source, name)` for every input and return the exit code of all (see `mesh_all`)."""
    codes = []
    for source, name in zip(request.sources, folder_names(request.sources), strict=True):
        with _failures_told(_label(source), debug=request.debug) as code:
            code.append(one(request, source, name))
        codes.append(code[-1])
    return overall(codes)


def _label(source: str) -> str:
    return source if is_generated(source) else Path(source).name or source


@contextmanager
def _failures_told(label: str, *, debug: bool) -> Iterator[list[int]]:
    """Turn what goes wrong with one input into one sentence on standard error and an exit code."""
    codes: list[int] = []
    try:
        yield codes
    except InputError as error:
        codes.append(error.exit_code)
        typer.echo(str(InputError(label, error.defect, error.remedy)), err=True)
    except MeshgenError as error:
        codes.append(error.exit_code)
        typer.echo(f"{label}: {error}", err=True)
    except OSError as error:
        codes.append(INTERNAL)
        typer.echo(f"{label}: {disk_sentence(error)}", err=True)
    except Exception as error:  # noqa: BLE001 - the other inputs shall have their turn
        codes.append(INTERNAL)
        typer.echo(f"{label}: internal error: {_sentence(error)}; --debug shows where", err=True)
        if debug:
            traceback.print_exception(error)


def _sentence(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return type(error).__name__ + (f": {lines[0]}" if lines else "")


def _mesh_one(request: Request, source: str, name: str) -> int:
    label, start = _label(source), time.perf_counter()
    with warnings.catch_warnings(record=True) as caught, bar(name) as show:
        warnings.simplefilter("always")
        options = settled(request, source)
        try:
            done = pipeline.run(
                source,
                options,
                triangles=request.triangles,
                compare=request.compare,
                store=request.store,
                progress=show,
            )
        except MeshgenError as error:
            _show_place(request, name, error)
            raise
        quality: Quality = done["quality"]
        with complete(request.out / name) as folder:
            write_results(folder, done, options)
            write_layout_file(folder, done, source, request.triangles, options)
            if request.compare:
                write_rivals(folder / "rivals", done)
            if request.pictures:
                write_pictures(folder, done)
            (request.out / name / DEFECT).unlink(missing_ok=True)  # of an earlier run
    tell(caught)
    typer.echo(verdict(name, quality.metrics, time.perf_counter() - start))
    if done["seams"].features:
        typer.echo(feature_line(done["smoothing"]))
    if options.decompose.zones:
        typer.echo(zone_table(options.decompose.zones, done["smoothing"].mesh.mesh).to_string(index=False))
    if request.compare:
        typer.echo(rival_table(done))
    if request.timings:
        typer.echo(timing_table(done))
    failed = gate(quality)
    if failed:
        typer.echo(f"{label}: below the quality gate: {'; '.join(failed)}", err=True)
    return BELOW_GATE if failed else FINE


def _show_place(request: Request, name: str, error: MeshgenError) -> None:
    """Draw where the surface is defective, if that is known and pictures are wanted, and say where the picture is."""
    if error.place is None or not request.pictures:
        return
    with complete(request.out / name) as folder:
        write_defect(folder, error.place)
    typer.echo(f"{name}: the place is shown in {request.out / name / DEFECT}", err=True)


def settled(request: Request, source: str) -> MeshOptions:
    """Return the options of one input, once its layout file and the limits of its layout are looked at."""
    if request.layout is not None:
        return steered(request.options, request.layout, source, request.triangles)
    return pipeline.coarsened(request.options, source, request.triangles)


def tell(caught: Sequence[warnings.WarningMessage]) -> None:
    """Show the warnings of this package, one line each."""
    for warning in caught:
        if warning.category.__module__.startswith("drl_meshgen"):
            typer.echo(f"warning: {warning.message}", err=True)


def verdict(name: str, metrics: Mapping[str, float], seconds: float) -> str:
    """Return one line on a mesh: quads, blocks, irregular nodes, extreme angles, time."""
    m = metrics
    return (
        f"{name:<16} {m['quads']:6.0f} quads  {m['named_blocks']:3.0f} blocks  {m['irregular']:3.0f} irregular  "
        f"angles {m['min_angle']:5.1f} to {m['max_angle']:5.1f}  {seconds:6.1f} s"
    )


def feature_line(final: FinalMesh) -> str:
    """Return one line on the sharp curves that mesh lines follow."""
    share, away = 100 * final.feature_share, final.feature_deviation
    return f"  sharp edges: mesh lines follow {share:.0f} % of their length, to within {away:.2g} (units of the input)"


def rival_table(done: Execution) -> str:
    """Return one line per rival: what its mesh is like, or why there is none."""
    seconds = next(timing.parts for timing in done.timings if timing.stage == "comparison")
    lines = []
    for row in done["comparison"].rows.to_dict("records"):
        name = str(row["method"])
        remark = "; ".join(text for text in (row["cause"], row["defects"]) if text)
        if name in seconds:
            figures = (
                f"{row['quads']:6.0f} quads  {row['irregular']:4.0f} irregular  "
                f"angles {row['min_angle']:5.1f} to {row['max_angle']:5.1f}  {seconds[name]:6.1f} s"
            )
            remark = f"{figures}  {remark}"
        lines.append(f"  {name:<26} {remark}".rstrip())
    return "\n".join(lines)


def timing_table(done: Execution) -> str:
    """Return one line per stage with its time, and their sum."""
    rows = [f"  {t.stage:<14} {t.seconds:8.3f} s{'  from the store' if t.cached else ''}" for t in done.timings]
    return "\n".join([*rows, f"  {'all stages':<14} {sum(t.seconds for t in done.timings):8.3f} s"])


@contextmanager
def bar(name: str) -> Iterator[Callable[[Step], None] | None]:
    """Show a progress bar with the stage's name while standard error is a terminal."""
    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.description}", markup=False),  # brackets in names are no styles
        BarColumn(),
        TextColumn("{task.fields[stage]:<12}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(f"{name:<16}", total=None, stage="")

        def show(step: Step) -> None:
            finished = step.index + (step.timing is not None)
            progress.update(task, completed=finished, total=step.total, stage=step.stage)

        yield show
