"""The tables of the report, all read back from Parquet, and how figures are printed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.quality import QuadShape
from drl_meshgen.quality.shape import own_normals
from drl_meshgen.report.inputs import OURS, ModelRun

PAPER = (
    ("giraffe", "Ours", 14.58, 166.58, 27.08, 3.1, 2.6),
    ("giraffe", "Bommes et al.", 12.73, 170.31, 48.84, 8.7, 23.2),
    ("giraffe", "Gmsh", 31.4, 168.55, 69.66, 5.76, 3.3),
    ("hand", "Ours", 8.84, 173.11, 51.6, 6.05, 5.9),
    ("hand", "Bommes et al.", 5.1, 176.26, 174.54, 41.62, 49.4),
    ("hand", "Gmsh", 14.57, 176.38, 161.69, 8.86, 53.0),
)
"""Table 5 of the paper as printed, measured by its authors on their own models."""


Row = dict[str, Any]
"""One row of a table, by column name."""


@dataclass(frozen=True)
class Column:
    """How a figure is shown."""

    key: str
    label: str
    digits: int
    better: str
    """`high`, `low` or empty where neither is better."""
    unit: str = ""
    note: str = ""


COLUMNS = (
    Column("quads", "Quads", 0, ""),
    Column("nodes", "Nodes", 0, ""),
    Column("irregular", "Irregular nodes", 0, "low", note="interior nodes with other than 4 edges"),
    Column("blocks", "Base-complex patches", 0, "low", note="patches when every separatrix runs to its end"),
    Column("named_blocks", "Blocks", 0, "low", note="named i × j blocks"),
    Column("t_junctions", "T-junctions", 0, "low", note="corners of a block inside a side of another"),
    Column("validity", "Validity", 2, "high", "%", "share of quads with four positive Jacobians"),
    Column("min_angle", "Minimum angle", 2, "high", "°"),
    Column("max_angle", "Maximum angle", 2, "low", "°"),
    Column("orthogonality", "Orthogonality", 4, "high", note="eq. 11 with the worst corner, mean"),
    Column("orthogonality_printed", "Orthogonality as printed", 4, "high", note="eq. 11 with the best corner, mean"),
    Column("compliance", "Within 15° of square", 2, "high", "%", "share of quads"),
    Column("jacobian_ratio", "Jacobian ratio", 4, "high", note="eq. 12, mean"),
    Column("scaled_jacobian_min", "Scaled Jacobian, worst", 4, "high"),
    Column("smoothness", "Smoothness", 4, "high", note="shorter / longer edge along mesh lines, mean"),
    Column("edge_ratio", "Edge ratio", 3, "low", note="longer / shorter edge along mesh lines, mean"),
    Column("warp", "Warp", 2, "low", "°", "largest fold along a diagonal"),
    Column("area_ratio", "Area ratio", 2, "low", note="largest between neighbours"),
    Column("side_ratio", "Side ratio", 2, "low", note="largest between neighbours"),
    Column("surface_deviation", "Surface deviation", 3, "low", "%", "Hausdorff, of the diagonal"),
    Column("surface_deviation_rms", "Surface deviation, RMS", 4, "low", "%", "of the diagonal"),
    Column("boundary_deviation", "Boundary deviation", 3, "low", "%", "Hausdorff, of the diagonal"),
    Column("boundary_deviation_rms", "Boundary deviation, RMS", 4, "low", "%", "of the diagonal"),
    Column("boundary_fit", "Boundary fit", 3, "high", note="exp(-MSE / h²)"),
    Column("boundary_mse", "Boundary MSE", 8, "low", note="eq. 14, of the squared diagonal"),
    Column("non_quads", "Faces that are not quads", 2, "low", "%"),
    Column("components", "Components", 0, ""),
    Column("loops", "Boundary loops", 0, ""),
    Column("euler", "Euler characteristic", 0, ""),
    Column("seconds", "Time", 2, "low", "s"),
)
BY_KEY = {c.key: c for c in COLUMNS}
TABLE_5 = ("min_angle", "max_angle", "warp", "area_ratio", "seconds")
HISTOGRAM_STEP = 5
"""Width of a bin of the angle histogram, degrees."""


def shown(column: Column, value: float) -> str:
    """Return a figure as text; a dash where there is none."""
    if not np.isfinite(value):
        return "–"
    figure = 100 * value if column.unit == "%" else value
    return f"{figure:,.{column.digits}f}"


def quality_table(runs: Sequence[ModelRun]) -> pd.DataFrame:
    """Return all quality rows of all models, `model` first."""
    parts = [run.quality.assign(model=run.name) for run in runs]
    table = pd.concat(parts, ignore_index=True)
    head = ["model", "method", "ok", "cause", "defects"]
    table = table.reindex(columns=[*head, *(c.key for c in COLUMNS)])
    return table.fillna({"cause": "", "defects": ""})


def timing_table(runs: Sequence[ModelRun]) -> pd.DataFrame:
    """Return `model`, `stage`, `seconds` for all models."""
    parts = [run.timings.assign(model=run.name) for run in runs]
    return pd.concat(parts, ignore_index=True).reindex(columns=["model", "stage", "seconds"])


def by_model(table: pd.DataFrame) -> dict[str, list[Row]]:
    """Return the rows of each model, models in order of appearance."""
    rows: dict[str, list[Row]] = {}
    for row in table.to_dict("records"):
        rows.setdefault(str(row["model"]), []).append({str(k): v for k, v in row.items()})
    return rows


def matrix(rows: Sequence[Row]) -> pd.DataFrame:
    """Return one model's quality rows turned: a metric per row, a method per column, as text."""
    out = {"metric": [c.label + (f" ({c.unit})" if c.unit else "") for c in COLUMNS]}
    for row in rows:
        out[row["method"]] = [shown(c, float(row[c.key])) for c in COLUMNS]
    return pd.DataFrame(out)


def table_5(quality: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of the paper's Table 5: `model`, `method`, `source`, figures; the paper's rows after ours."""
    keys = ["model", "method", "source", *TABLE_5]
    paper = pd.DataFrame(list(PAPER), columns=["model", "method", *TABLE_5]).assign(source="printed in the paper")
    printed = by_model(paper)
    rows: list[Row] = []
    for model, measured in by_model(quality).items():
        rows += [row | {"source": "measured here"} for row in measured]
        rows += printed.get(model, [])
    return pd.DataFrame(rows).reindex(columns=keys)


def angle_histogram(runs: Sequence[ModelRun]) -> pd.DataFrame:
    """Return the share of corners per bin of angle: `model`, `method`, `from` (degrees), `share`."""
    edges = np.arange(0, 180 + HISTOGRAM_STEP, HISTOGRAM_STEP)
    rows = []
    for run in runs:
        meshes: dict[str, QuadMesh] = {OURS: run.mesh.mesh, **run.rivals}
        for method, mesh in meshes.items():
            corners = mesh.points[mesh.quads]
            angle = np.clip(QuadShape(corners, own_normals(corners)).angle, 0, 180)
            count = np.histogram(angle, edges)[0]
            rows.append(
                pd.DataFrame(
                    {"model": run.name, "method": method, "from": edges[:-1], "share": count / max(1, count.sum())}
                )
            )
    return pd.concat(rows, ignore_index=True)


def worst_table(run: ModelRun, shape: QuadShape, count: int) -> pd.DataFrame:
    """Return the worst quads of our mesh, worst first: quad, block and place in it, extreme angles."""
    quad = shape.worst(count)
    return pd.DataFrame(
        {
            "model": run.name,
            "quad": quad,
            "block": run.mesh.block[quad],
            "i": run.mesh.i[quad],
            "j": run.mesh.j[quad],
            "min_angle": shape.min_angle[quad],
            "max_angle": shape.max_angle[quad],
        }
    )


def best_rows(rows: Sequence[Row], column: Column) -> list[bool]:
    """Return for each row whether it has the best figure of a column, among whole and valid meshes without defects.

    No row is marked where fewer than two compete or all are equal.
    """
    sign = {"high": 1.0, "low": -1.0, "": np.nan}[column.better]
    fair = [bool(row["ok"]) and not row["defects"] and float(row["validity"]) == 1 for row in rows]
    values = np.array([sign * float(row[column.key]) if f else np.nan for row, f in zip(rows, fair, strict=True)])
    there = np.isfinite(values)
    if not there.any() or np.ptp(values[there]) == 0:
        return [False] * len(rows)
    return (there & (values == values[there].max())).tolist()


def latex(table: pd.DataFrame, caption: str) -> str:
    """Return a table in LaTeX (booktabs), figures with the digits of the report."""
    special = str.maketrans(
        {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "°": r"$^\circ$", "²": r"$^2$", "×": r"$\times$"}
    )

    def text(value: object) -> str:
        return str(value).translate(special)

    columns = [BY_KEY.get(c) for c in table.columns]
    head = [text(str(k).capitalize() if c is None else c.label) for k, c in zip(table.columns, columns, strict=True)]
    body = [
        [text(v) if c is None else text(shown(c, v).replace(",", "")) for v, c in zip(row, columns, strict=True)]
        for row in table.itertuples(index=False, name=None)
    ]
    form = "".join("l" if c is None else "r" for c in columns)
    lines = [" & ".join(cells) + r" \\" for cells in (head, *body)]
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{text(caption)}}}",
            rf"\begin{{tabular}}{{{form}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )
