"""Folders of results: their names, their files, and that they appear whole or not at all."""

import ctypes
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.codecs import COMPARISON
from drl_meshgen.commands.layout_file import layout_text
from drl_meshgen.commands.settings import to_toml
from drl_meshgen.decompose import Description, Layout, Zone, describe
from drl_meshgen.errors import Place
from drl_meshgen.export import write_block_mesh, write_curves, write_surface, write_surface_ply, write_table
from drl_meshgen.mesh import QuadMesh
from drl_meshgen.models import is_generated
from drl_meshgen.partition import Partition
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.quality import gate
from drl_meshgen.store import Execution

DEFECT = "defect.png"
"""Picture of the place where a surface or a mesh is defective."""


def folder_names(sources: Sequence[str]) -> tuple[str, ...]:
    """Return a folder name per input: the model's name, or the file's name without its suffix.

    Where a name is taken by an earlier input (upper and lower case count as the same), `-2`, `-3` ... is appended.
    """
    names: list[str] = []
    taken: set[str] = set()
    for source in sources:
        generated = is_generated(source)
        stem = source.replace(":", "-") if generated else Path(source).stem.strip(". ") or "surface"
        name, n = stem, 1
        while name.lower() in taken:
            n += 1
            name = f"{stem}-{n}"
        taken.add(name.lower())
        names.append(name)
    return tuple(names)


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Give an empty folder beside `folder` to write to; its files become those of `folder` at the end.

    On failure nothing is left behind. Files of other names that `folder` already has stay.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    try:
        yield part
        part.chmod(0o755)
        if not folder.exists():
            part.rename(folder)
            return
        for file in sorted(path for path in part.rglob("*") if path.is_file()):
            target = folder / file.relative_to(part)
            target.parent.mkdir(parents=True, exist_ok=True)
            file.replace(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_results(folder: Path, done: Execution, options: MeshOptions) -> None:
    """Write mesh, layout, tables, the cleaned surface, and the options that `--config` takes."""
    write_block_mesh(folder, done["smoothing"].mesh)
    write_surface_ply(folder / "surface.ply", done["cleanup"].surface)
    write_table(folder / "quality.parquet", pd.DataFrame([done["quality"].metrics]))
    if options.decompose.zones:
        write_table(folder / "zones.parquet", zone_table(options.decompose.zones, done["smoothing"].mesh.mesh))
    (folder / "options.toml").write_text(to_toml(options), "utf-8")


def write_layout_file(folder: Path, done: Execution, source: str, triangles: int, options: MeshOptions) -> None:
    """Write `layout.toml`, which can be edited and given to `mesh --layout`."""
    (folder / "layout.toml").write_text(layout_text(_description(done, options), source, triangles, options), "utf-8")


def _description(done: Execution, options: MeshOptions) -> Description:
    layout: Layout = done["decompose"]
    return describe(done["partition"], layout, options.decompose, done["sizing"].at(layout.spacing))


def write_layout_curves(folder: Path, done: Execution, options: MeshOptions) -> None:
    """Write `layout.vtp`, all edges of the layout as polylines, and `layout.vtu`, the surface with its regions."""
    parts: Partition = done["partition"]
    layout: Layout = done["decompose"]
    edges = _description(done, options).edges
    cut = parts.surface.mesh
    lines = [junction.points[path] for junction in layout.pieces.junctions for path in junction.spine.paths]
    lines += [cut.vertices[np.r_[curve.vertices, curve.vertices[:1]]] for curve in parts.curves]
    arrays = {key: [getattr(edge, key) for edge in edges] for key in ("name", "count", "wanted", "length")}
    write_curves(folder / "layout.vtp", lines, {**arrays, "kind": [edge.kind.value for edge in edges]})
    region = {"region": parts.region.astype(np.int32)}
    write_surface(folder / "layout.vtu", cut, {"depth": parts.surface.depth}, region)


def zone_table(zones: tuple[Zone, ...], mesh: QuadMesh) -> pd.DataFrame:
    """Return one row per zone: irregular nodes `inside`, distance of its centre to the `nearest` (model units)."""
    nodes = mesh.points[mesh.irregular]
    rows = [
        {
            "zone": k,
            "kind": zone.kind,
            "inside": int(zone.contains(nodes).sum()),
            "nearest": float(zone.distances(nodes).min(initial=np.inf)),
        }
        for k, zone in enumerate(zones)
    ]
    return pd.DataFrame(rows, columns=["zone", "kind", "inside", "nearest"])


def write_rivals(folder: Path, done: Execution) -> None:
    """Write `rivals.parquet` and the mesh of each rival."""
    folder.mkdir()
    COMPARISON.write(done["comparison"], folder)


def can_draw() -> bool:
    """Tell whether pictures can be drawn without a display: on Linux VTK needs EGL and crashes without."""
    if sys.platform != "linux":
        return True
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True


def write_defect(folder: Path, place: Place) -> Path:
    """Write `defect.png`, the place where something is wrong, and return its path."""
    from drl_meshgen.report import pictures
    from drl_meshgen.report.places import draw_place

    pictures.write_png(folder / DEFECT, draw_place(place))
    return folder / DEFECT


def write_pictures(folder: Path, done: Execution) -> None:
    """Write `depth.png`, `regions.png`, `blocks.png` and `quality.png`, all from one camera.

    For a mesh below the quality gate also `defect.png`.
    """
    from drl_meshgen.report import pictures
    from drl_meshgen.report.places import worst_quads
    from drl_meshgen.report.view import best_view

    parts: Partition = done["partition"]
    cut, mesh = parts.surface.mesh, done["smoothing"].mesh
    view = best_view(done["cleanup"].surface)
    contours = [cut.vertices[np.r_[c.vertices, c.vertices[:1]]] for c in parts.curves if not c.is_boundary]
    images = {
        "depth": pictures.draw_depth(cut, parts.surface.depth, contours, view),
        "regions": pictures.draw_regions(cut, parts.region, contours, view),
        "blocks": pictures.draw_blocks(mesh, view),
        "quality": pictures.draw_quality(mesh.mesh, done["quality"].shape, view),
    }
    for name, image in images.items():
        pictures.write_png(folder / f"{name}.png", image)
    if gate(done["quality"]):
        write_defect(folder, worst_quads(mesh.mesh, done["quality"].shape))
