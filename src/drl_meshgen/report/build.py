"""Building the report: tables to Parquet, CSV and LaTeX, pictures, one page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from drl_meshgen.export import read_table, replacing, write_table
from drl_meshgen.quality import QuadShape
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.metrics import surface_normals
from drl_meshgen.report import palette, pictures, tables
from drl_meshgen.report.charts import angle_chart
from drl_meshgen.report.closeups import draw_quad
from drl_meshgen.report.inputs import OURS, ModelRun
from drl_meshgen.report.view import best_view

_TABLES = ("quality", "table5", "timings", "angles", "worst")
_STRIP = ("quads", "named_blocks", "irregular", "min_angle", "max_angle", "validity", "seconds")


@dataclass(frozen=True)
class ReportOptions:
    """What the report shows."""

    title: str = "Block-structured quad meshes"
    """Heading of the page."""
    worst: int = 20
    """How many of the worst quads are shown (count)."""
    picture_size: int = pictures.LONG_SIDE
    """Longer side of the pictures of whole models (pixels)."""
    gate: str = "100 % valid, no structural defect, angles within 5°–175°"
    """What the verdict was judged by, in words."""


def slug(name: str) -> str:
    """Return a name of a model, method or picture as it stands in file names."""
    return "".join(c if c.isalnum() else "-" for c in name.lower()).strip("-")


def _shape(run: ModelRun) -> QuadShape:
    normals, _ = surface_normals(run.mesh.mesh, TriangleSearch(run.surface.corners), run.surface)
    return QuadShape(run.mesh.points[run.mesh.mesh.quads], normals)


def _draw(run: ModelRun, shape: QuadShape, worst: pd.DataFrame, folder: Path, size: int) -> dict[str, str]:
    """Draw all pictures of a model into a folder; returns picture -> path relative to the page."""
    view = best_view(run.surface)
    drawn = {
        "depth": pictures.draw_depth(run.cut_surface, run.depth, run.contours, view, long_side=size),
        "regions": pictures.draw_regions(run.cut_surface, run.region, run.contours, view, long_side=size),
        "blocks": pictures.draw_blocks(run.mesh, view, long_side=size),
        "quality": pictures.draw_quality(run.mesh.mesh, shape, view, long_side=size),
        "mesh " + OURS: pictures.draw_mesh(run.mesh.mesh, view, long_side=size),
    }
    for method, mesh in run.rivals.items():
        drawn["mesh " + method] = pictures.draw_mesh(mesh, view, run.rival_triangles.get(method), long_side=size)
    paths = {name: folder / f"{slug(name)}.png" for name in drawn}
    for name, image in drawn.items():
        pictures.write_png(paths[name], image)
    for rank, quad in enumerate(worst["quad"]):
        paths[f"worst {rank:02}"] = folder / f"worst-{rank:02}.svg"
        with replacing(paths[f"worst {rank:02}"]) as part:
            part.write_text(draw_quad(run.mesh.mesh, shape, int(quad)), encoding="utf-8")
    return {name: f"{folder.parent.name}/{folder.name}/{path.name}" for name, path in paths.items()}


def _write_tables(runs: Sequence[ModelRun], worst: Sequence[pd.DataFrame], folder: Path) -> dict[str, pd.DataFrame]:
    """Write every table as Parquet and return what is read back from there: the page shows nothing else."""
    quality = tables.quality_table(runs)
    made = {
        "quality": quality,
        "table5": tables.table_5(quality),
        "timings": tables.timing_table(runs),
        "angles": tables.angle_histogram(runs),
        "worst": pd.concat(worst, ignore_index=True),
    }
    for name in _TABLES:
        write_table(folder / f"{name}.parquet", made[name])
    back = {name: read_table(folder / f"{name}.parquet") for name in _TABLES}
    for name in ("quality", "table5", "timings"):
        with replacing(folder / f"{name}.csv") as part:
            back[name].to_csv(part, index=False, lineterminator="\n", float_format="%.10g")
    captions = {
        "table5": "Quality of the meshes; rows of the paper are its own figures on its own models",
        "timings": "Seconds per stage",
    }
    for name, caption in captions.items():
        with replacing(folder / f"{name}.tex") as part:
            part.write_text(tables.latex(back[name], caption), encoding="utf-8")
    per_model = tables.by_model(back["quality"]).items()
    with replacing(folder / "quality.tex") as part:
        pieces = [tables.latex(tables.matrix(rows), f"All metrics: {model}") for model, rows in per_model]
        part.write_text("\n".join(pieces), encoding="utf-8")
    return back


def _cells(rows: Sequence[tables.Row], columns: Sequence[tables.Column]) -> list[dict[str, Any]]:
    """Rows of a table as the template takes them: method, remarks and printed figures, the best ones marked."""
    best = {c.key: tables.best_rows(rows, c) for c in columns}
    return [
        {
            "method": row["method"],
            "ours": row["method"] == OURS,
            "ok": bool(row["ok"]),
            "cause": row["cause"],
            "defects": row["defects"],
            "figures": {c.key: {"text": tables.shown(c, float(row[c.key])), "best": best[c.key][k]} for c in columns},
        }
        for k, row in enumerate(rows)
    ]


def _timings(rows: Sequence[tables.Row]) -> dict[str, Any]:
    total = sum(float(row["seconds"]) for row in rows)
    stages = [
        {
            "stage": row["stage"],
            "seconds": f"{row['seconds']:.2f}",
            "share": round(100 * float(row["seconds"]) / total, 2) if total > 0 else 0.0,
        }
        for row in rows
    ]
    return {"stages": stages, "total": f"{total:.2f}"}


def _model(name: str, rows: dict[str, list[tables.Row]], shown: dict[str, str]) -> dict[str, Any]:
    """Everything the page says about one model, out of the tables that were read back."""
    methods = _cells(rows["quality"], tables.COLUMNS)
    ours = next(m for m in methods if m["ours"])
    table_5 = [tables.BY_KEY[key] for key in tables.TABLE_5]
    paper = [row for row in rows["table5"] if row["source"] != "measured here"]
    worst = [
        {
            "picture": shown[f"worst {rank:02}"],
            "angles": f"{row['min_angle']:.1f}° – {row['max_angle']:.1f}°",
            "place": f"block {row['block']} ({row['i']}, {row['j']})",
        }
        for rank, row in enumerate(rows["worst"])
    ]
    return {
        "name": name,
        "id": slug(name),
        "ours": ours,
        "strip": [(tables.BY_KEY[key], ours["figures"][key]["text"]) for key in _STRIP],
        "methods": methods,
        "paper": [
            {"method": row["method"], "figures": {c.key: tables.shown(c, float(row[c.key])) for c in table_5}}
            for row in paper
        ],
        "pictures": shown,
        "worst": worst,
        "chart": Markup(angle_chart(rows["angles"], [m["method"] for m in methods])),  # noqa: S704 - figures only
        "timings": _timings(rows["timings"]),
    }


def build_report(runs: Sequence[ModelRun], folder: Path | str, options: ReportOptions | None = None) -> Path:
    """Write `index.html`, `tables/` (Parquet, CSV, LaTeX) and `pictures/` into a folder; returns the page's path.

    Every figure on the page is read back from `tables/*.parquet`. Same runs, same bytes. Raises `ValueError` where a
    run has no row of ours.
    """
    options = options or ReportOptions()
    folder = Path(folder)
    for run in runs:
        if OURS not in run.quality["method"].tolist():
            raise ValueError(f"{run.name}: no row of {OURS} in its quality table")
    shapes = [_shape(run) for run in runs]
    worst = [tables.worst_table(run, shape, options.worst) for run, shape in zip(runs, shapes, strict=True)]
    read = _write_tables(runs, worst, folder / "tables")
    rows = {name: tables.by_model(table) for name, table in read.items()}
    models = []
    for run, shape, bad in zip(runs, shapes, worst, strict=True):
        shown = _draw(run, shape, bad, folder / "pictures" / slug(run.name), options.picture_size)
        models.append(_model(run.name, {name: found[run.name] for name, found in rows.items()}, shown))
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("template.html.j2").render(
        options=options,
        models=models,
        columns=tables.COLUMNS,
        table_5=[tables.BY_KEY[key] for key in tables.TABLE_5],
        palette=palette,
        ours=OURS,
    )
    with replacing(folder / "index.html") as part:
        part.write_text(page, encoding="utf-8")
    return folder / "index.html"
