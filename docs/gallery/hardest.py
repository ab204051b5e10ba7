"""Draw the hardest surfaces of a robustness run on one sheet: `python docs/gallery/hardest.py out/robustness`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from drl_meshgen import TriMesh, load
from drl_meshgen.benchmarks.examine import Case, kept
from drl_meshgen.benchmarks.robustness import MESHES, RANDOM, random_cases
from drl_meshgen.benchmarks.summary import HARDEST, SHEET, hardest, write_summary
from drl_meshgen.benchmarks.tables import records
from drl_meshgen.export import read_table, replacing
from drl_meshgen.report import pictures
from drl_meshgen.report.view import best_view

TILE, CAPTION, COLUMNS = 360, 44, 5
"""Pixels of a picture's longer side, of the two lines below it; pictures side by side."""


def case_of(row: dict, models: Path) -> Case:
    """Return the case of a row of the table."""
    if row["kind"] == RANDOM:
        (case,) = random_cases(range(row["seed"], row["seed"] + 1))
        return case
    (path,) = (models / row["kind"]).glob(f"{row['surface']}.*")
    return Case(row["kind"], row["surface"], str(path), None, row["remesh"], row["target"])


def picture(row: dict, models: Path, work: Path) -> np.ndarray:
    """Draw the blocks of a row from the mesh the run kept, or the triangles of its surface where there is none."""
    case = case_of(row, models)
    found = kept(case, work / MESHES) if row["quads"] > 0 else None
    if found is not None:
        mesh, surface = found
        return pictures.draw_blocks(mesh, best_view(surface), long_side=TILE)
    raw = load(case.source)
    scene = pictures.Scene(best_view(TriMesh(raw.points, raw.triangles)), TILE)
    scene.faces(raw.points, raw.triangles, lines=0.4)
    return scene.shoot()


def caption(row: dict) -> str:
    """Return two lines on a row."""
    said = f"{row['min_angle']:.0f} to {row['max_angle']:.0f} degrees" if row["quads"] > 0 else row["status"]
    remeshed = ", remeshed" if row["remesh"] else ""
    return f"{row['surface']}{remeshed}, {row['target']:,}\n{said}, score {row['score']:.2f}"


def sheet(tiles: Sequence[np.ndarray], captions: Sequence[str]) -> Image.Image:
    """Put pictures in rows, each with its caption below."""
    lines = -(-len(tiles) // COLUMNS)
    page = Image.new("RGB", (TILE * min(COLUMNS, len(tiles)), (TILE + CAPTION) * lines), "white")
    pen = ImageDraw.Draw(page)
    for k, (tile, text) in enumerate(zip(tiles, captions, strict=True)):
        x, y = TILE * (k % COLUMNS), (TILE + CAPTION) * (k // COLUMNS)
        height, width = tile.shape[:2]
        page.paste(Image.fromarray(tile), (x + (TILE - width) // 2, y + (TILE - height) // 2))
        pen.text((x + 8, y + TILE + 4), text, fill="black", font_size=15)
    return page


def main(arguments: list[str] | None = None) -> Path:
    """Draw the sheet beside the table, show it in the summary, return its path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder with robustness.parquet")
    parser.add_argument("--models", type=Path, default=Path("../shared/models"))
    parser.add_argument("--work", type=Path, default=Path("out/robustness"), help="folder with the meshes of the run")
    parser.add_argument("--count", type=int, default=HARDEST)
    given = parser.parse_args(arguments)

    rows = records(hardest(read_table(given.folder / "robustness.parquet"), given.count))
    tiles = [picture(row, given.models, given.work) for row in rows]
    with replacing(given.folder / SHEET) as part:
        sheet(tiles, [caption(row) for row in rows]).save(part, quality=80, optimize=True)
    write_summary(given.folder)
    print(given.folder / SHEET)
    return given.folder / SHEET


if __name__ == "__main__":
    main()
