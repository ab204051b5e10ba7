"""Flow `train`: the policy that chooses templates, trained from nothing or from where an earlier run ended."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from PIL import Image
from prefect import State, flow, task
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.runtime import flow_run
from prefect.states import Completed

from drl_meshgen.commands.arguments import leave
from drl_meshgen.errors import FINE, InputError
from drl_meshgen.export import read_table
from drl_meshgen.report import palette
from drl_meshgen.report.plane import new_figure
from flows import run_command
from flows.pictures import jpeg
from flows.server import connected
from tasks.progress import shown

OUT = "out/train"
SHOWN = ("reward", "orthogonality", "jacobian", "valid")
"""What the curves show of each validation set."""


def _run_name() -> str:
    given = flow_run.parameters
    limit = f", {given['minutes']:g} minutes" if given.get("minutes") else ""
    seed = "" if given.get("seed") is None else f" seed {given['seed']}"
    return f"train {Path(given.get('out', OUT)).name}{seed}{limit}"


@task(name="training", task_run_name="training {out}")
def training(out: str, given: dict[str, Any]) -> bool:
    """Train until the end or the limit; returns whether it came to the end."""
    try:  # imported here because it takes seconds, and belongs to an extra
        from drl_meshgen.rl.train import train
    except ImportError as error:
        raise InputError("training", f"needs the package {error.name}", "pip install 'drl-meshgen[rl]'") from error
    with shown(f"training {Path(out).name}", whole=False):
        return train(Path(out), **given)


@flow(name="train", flow_run_name=_run_name, description=__doc__)
def train(
    *,
    minutes: float | None = None,
    steps: int | None = None,
    seed: int | None = None,
    domains: int | None = None,
    transition_steps: int | None = None,
    threads: int = 1,
    out: str = OUT,
) -> State[str]:
    """Train the policy; what is left out is as `make train` has it.

    `minutes` ends the run early, and the next one with the same parameters goes on from there; `steps` are those from
    nothing to the end, `transition_steps` those of C-type meshes in a process beside, `domains` the number of training
    domains of each kind; `out` is the folder of checkpoints, curves and policy. The state's data are the path of the
    policy.
    """
    wanted = {
        "minutes": minutes,
        "steps": steps,
        "seed": seed,
        "domains": domains,
        "transition_steps": transition_steps,
    }
    given = {name: value for name, value in wanted.items() if value is not None} | {"threads": threads}
    ended = training(out, given)
    curve = read_table(Path(out) / "curve.parquet")
    told = f"{'trained' if ended else 'ended early'} after {curve['step'].iloc[-1]:.0f} steps"
    create_markdown_artifact(page(curve, told, out, ended=ended), key="training", description=told)
    create_table_artifact(curve.to_dict("records"), key="training-curve", description=f"Learning curve: {told}")
    return Completed(message=told, data=str(Path(out) / "agent.safetensors"))


def page(curve: pd.DataFrame, told: str, out: str, *, ended: bool) -> str:
    """Return the page of a training as Markdown: the learning curve, and the last figures."""
    last = curve.iloc[-1]
    sets = sorted({name.rpartition(" ")[0] for name in curve if name.rpartition(" ")[2] in SHOWN})
    lines = [f"# Training: {told}", "", f"![learning curve]({draw_curve(curve, sets)})", ""]
    lines += [f"| validation set | {' | '.join(SHOWN)} |", "| --- |" + " ---: |" * len(SHOWN)]
    for one in sets:
        cells = [f"{last[f'{one} {name}']:.4f}" for name in SHOWN]
        lines.append(f"| {one} | {' | '.join(cells)} |")
    hint = "" if ended else " The same run again goes on from here."
    return "\n".join([*lines, "", f"Policy, checkpoint and curves are in the folder `{out}`.{hint}", ""])


def draw_curve(curve: pd.DataFrame, sets: Sequence[str]) -> str:
    """Return the reward on each validation set over the steps as a `data:` address."""
    figure = new_figure(8, 3.2)
    axes = figure.add_subplot()
    for one, colour in zip(sets, (palette.DEPTH[4], palette.CONTOUR), strict=False):
        axes.plot(curve["step"], curve[f"{one} reward"], color=colour, label=one, marker="." if len(curve) < 20 else "")
    axes.set_xlabel("steps")
    axes.set_ylabel("reward")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, facecolor="white")
    with Image.open(buffer) as image:
        return jpeg(image.convert("RGB"))


def main(
    *,
    minutes: Annotated[float | None, typer.Option(min=0, help="End after so long; the next run goes on.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Steps from nothing to the end.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of weights and draws.")] = None,
    domains: Annotated[int | None, typer.Option(min=2, help="Training domains of each kind.")] = None,
    transition_steps: Annotated[int | None, typer.Option(min=1, help="Steps of C-type meshes.")] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of checkpoints, curves and policy.")] = Path(OUT),
) -> None:
    """Run the train flow against a Prefect server; a local one is started if need be."""

    def command() -> int:
        with connected() as api:
            state = train(
                minutes=minutes,
                steps=steps,
                seed=seed,
                domains=domains,
                transition_steps=transition_steps,
                threads=threads,
                out=str(out),
                return_state=True,
            )
            result = state.result(raise_on_failure=False)
            if isinstance(result, BaseException):
                raise result
        typer.echo(f"{state.message}: {result}\ndashboard: {api.removesuffix('/api')}")
        return FINE

    leave(command, debug=False)


if __name__ == "__main__":
    run_command(main)
