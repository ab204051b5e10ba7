"""The paper's Figures 9 to 12 as pictures, from data in a folder; a figure whose data are not there is left out."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drl_meshgen.baselines.plane import PlaneMethod, PlaneRival, plane_rivals
from drl_meshgen.benchmarks.rl_judge import FINISHED, OURS, Chooser, made_by, policy_of
from drl_meshgen.benchmarks.tables import records
from drl_meshgen.benchmarks.templates import PIPELINE, SETS, domain_named, parameters_in
from drl_meshgen.export import read_table
from drl_meshgen.report import palette
from drl_meshgen.report.learning import ShownFigure
from drl_meshgen.report.plane import frame_of, new_figure, show_quads, write_figure
from drl_meshgen.rl.c_domains import samples_of_test
from drl_meshgen.rl.datasets import Sample, read_samples, samples_of
from drl_meshgen.rl.finish import finished
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.templates import RulePolicy, instantiate, instantiated
from drl_meshgen.templates.mesh import TemplateMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"test-standard": "#2f6690", "test-hard": "#c8452f", PIPELINE: "#4f8f5f", "train": "#2f6690"}
"""Outlines of the domains of each set: blue standard, red hard, as in the paper, green from the pipeline."""
SIDE_BY_SIDE = (("test-standard", 0), ("test-standard", 7), ("test-hard", 3), ("test-hard", 5))
"""Domains of Figure 12."""
TRANSITIONAL = (4, 6, 19, 24, 48, 58)
"""Domains of Test-C that are drawn."""
CHOSEN = 0.6
"""Weight of orthogonality that the paper settles for."""


def draw_figures(folder: Path) -> list[ShownFigure]:
    """Draw every figure whose data are in the folder."""
    made = [draw_sets(folder, folder / "figure9.png")]
    if (folder / "pareto.parquet").is_file():
        made.append(draw_front(folder))
    if (folder / "stages.parquet").is_file():
        made.append(draw_stages(folder))
    policy = policy_of(OURS, folder)
    if policy is not None:
        made += [draw_rivals(folder, policy), draw_transitions(folder, policy)]
    return made


def draw_sets(folder: Path, path: Path, *, rows: int = 4, columns: int = 12) -> ShownFigure:
    """Draw Figure 9: some domains of each set, as a PNG file; Test-Pipeline comes from `folder`."""
    sets = [list(samples_of(data, range(rows * columns))) for data in SETS]
    if (folder / f"{PIPELINE}.parquet").is_file():
        harvested = read_samples(folder / f"{PIPELINE}.parquet")
        step = max(1, -(-len(harvested) // (rows * columns)))
        sets.append(harvested[::step])
    figure = new_figure(columns, 0.95 * rows * len(sets))
    for block, samples in enumerate(sets):
        for k, sample in enumerate(samples):
            axes = figure.add_subplot(rows * len(sets), columns, block * rows * columns + k + 1)
            nodes, colour = sample.domain.nodes, COLOURS[sample.set]
            axes.fill(*nodes.T, facecolor=f"{colour}22", edgecolor=colour, linewidth=0.9)
            frame_of(axes, nodes)
    write_figure(path, figure, 90)
    caption = "Test-Standard (blue), Test-Hard (red), and domains harvested from the pipeline (green)."
    return ShownFigure("Figure 9: domains", caption, path)


def draw_front(folder: Path) -> ShownFigure:
    """Draw Figure 10: mean orthogonality and shape quality by the weight of orthogonality."""
    rows = records(read_table(folder / "pareto.parquet"))
    weights = sorted({float(row["w_orth"]) for row in rows})
    points = np.array(
        [
            np.mean([(r["orthogonality"], r["jacobian_ratio"]) for r in rows if r["w_orth"] == weight], axis=0)
            for weight in weights
        ]
    )
    figure = new_figure(6, 4.5)
    axes = figure.add_subplot()
    axes.plot(*points.T, "o-", color="#2f6690", linewidth=1.4)
    for weight, point in zip(weights, points, strict=True):
        axes.annotate(f"{weight:.1f}", tuple(point), xytext=(5, 5), textcoords="offset points", fontsize=8)
    star = int(np.abs(np.array(weights) - CHOSEN).argmin())
    axes.plot(*points[star], "*", color=palette.WORST, markersize=15)
    axes.set_xlabel("orthogonality")
    axes.set_ylabel("shape quality (Jacobian ratio)")
    axes.grid(visible=True, color=palette.PLAIN)
    path = folder / "figure10.png"
    write_figure(path, figure)
    caption = f"Each point is a policy trained with that weight of orthogonality; the star is the weight {CHOSEN}."
    return ShownFigure("Figure 10: weights within the quality", caption, path)


def draw_stages(folder: Path) -> ShownFigure:
    """Draw Figure 11: one domain, its mesh early in training, its mesh at the end."""
    rows = records(read_table(folder / "stages.parquet"))
    samples = [domain_named(row["set"], row["index"]) for row in rows]
    figure = new_figure(5 * (len(rows) + 1), 5)
    axes = figure.add_subplot(1, len(rows) + 1, 1)
    nodes = samples[0].domain.nodes
    axes.fill(*nodes.T, facecolor="#2f669022", edgecolor="#2f6690")
    axes.set_title("domain")
    frame_of(axes, nodes)
    for k, (row, sample) in enumerate(zip(rows, samples, strict=True), 2):
        mesh = instantiate(sample.domain, parameters_in(row))
        _panel(figure.add_subplot(1, len(rows) + 1, k), sample, str(row["stage"]), mesh)
    path = folder / "figure11.png"
    write_figure(path, figure)
    return ShownFigure("Figure 11: learning", "One training domain, early in training and at its end.", path)


def draw_rivals(folder: Path, policy: Chooser, domains: Sequence[tuple[str, int]] = SIDE_BY_SIDE) -> ShownFigure:
    """Draw Figure 12: ours, plain and finished, beside Gmsh's methods."""
    columns = 2 + len(PlaneMethod)
    figure = new_figure(4.2 * columns, 4.4 * len(domains))
    for row, (name, index) in enumerate(domains):
        sample = domain_named(name, index)
        mesh = instantiate(sample.domain, policy.choose(sample.domain))
        axes = figure.add_subplot(len(domains), columns, row * columns + 1)
        _panel(axes, sample, OURS, mesh)
        parameters = made_by(policy_of(FINISHED, folder) or policy, sample)
        if parameters is not None:
            axes = figure.add_subplot(len(domains), columns, row * columns + 2)
            _panel(axes, sample, FINISHED, finished(instantiated(sample.domain, parameters), len(sample.domain)))
        corners = np.array([grid[0, 0] for grid in mesh.grids[1:]])
        for k, (method, made) in enumerate(plane_rivals(sample.domain.nodes, corners).items(), 3):
            axes = figure.add_subplot(len(domains), columns, row * columns + k)
            if len(made.quads):
                _panel(axes, sample, method.value, made)
            else:
                axes.set_title(f"{method.value}: {made.outcome.value}", fontsize=9)
                axes.set_axis_off()
    path = folder / "figure12.png"
    write_figure(path, figure, 60)
    caption = "The same boundary nodes for all. Colours: largest deviation of a corner from 90°; folded quads are red."
    return ShownFigure("Figure 12: side by side", caption, path)


def draw_transitions(folder: Path, policy: Chooser, domains: Sequence[int] = TRANSITIONAL) -> ShownFigure:
    """Draw C-type meshes of some domains of Test-C: ours above those of the rule."""
    figure = new_figure(3.2 * len(domains), 7)
    for column, sample in enumerate(samples_of_test(domains), 1):
        for row, (label, chooser) in enumerate(((OURS, policy), ("rule", RulePolicy()))):
            parameters = made_by(chooser, sample)
            if parameters is not None:
                axes = figure.add_subplot(2, len(domains), row * len(domains) + column)
                _panel(axes, sample, label, instantiated(sample.domain, parameters))
    path = folder / "transitions.png"
    write_figure(path, figure, 60)
    return ShownFigure("C-type transitions", "Four-sided domains of Test-C; below, balanced counts and Tutte's.", path)


def _panel(axes: "Axes", sample: Sample, label: str, mesh: TemplateMesh | PlaneRival) -> None:
    points, quads = np.array(mesh.points), np.array(mesh.quads)
    show_quads(axes, points, quads, mesh.grids if isinstance(mesh, TemplateMesh) else (), by="angle")
    found = plane_metrics(sample.domain, points, quads)
    names = ("orthogonality", "shape", "smoothness")
    values = (found[key] for key in ("orthogonality", "jacobian_ratio", "smoothness"))
    text = f"{label}\n" + ", ".join(f"{name} {value:.3f}" for name, value in zip(names, values, strict=True))
    axes.set_title(text, fontsize=9)
