"""Mesh a model and draw its blocks: `python docs/gallery/mesh_and_draw.py hand --quads 4000 --out out/gallery`."""

import argparse
from pathlib import Path

from drl_meshgen import MeshOptions, run
from drl_meshgen.export import write_block_mesh


def main(arguments: list[str] | None = None) -> Path:
    """Write mesh, tables and a picture; return the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", nargs="?", default="hemisphere", help="model name or file")
    parser.add_argument("--quads", type=int, default=2000)
    parser.add_argument("--triangles", type=int, default=25_000)
    parser.add_argument("--out", type=Path, default=Path("out/gallery"))
    parser.add_argument("--no-picture", action="store_true")
    given = parser.parse_args(arguments)

    done = run(given.source, MeshOptions().sized(given.quads), triangles=given.triangles)
    mesh, quality = done["smoothing"].mesh, done["quality"]

    write_block_mesh(given.out, mesh)
    if not given.no_picture:
        from drl_meshgen.report import pictures
        from drl_meshgen.report.view import best_view

        image = pictures.draw_blocks(mesh, best_view(done["cleanup"].surface))
        pictures.write_png(given.out / "blocks.png", image)

    shown = ("quads", "named_blocks", "irregular", "min_angle", "max_angle", "orthogonality", "surface_deviation")
    for name in shown:
        print(f"{name:<18} {quality.metrics[name]:.4g}")
    for block, grid in enumerate(mesh.grids[:5]):
        print(f"block {block}: {grid.shape[0] - 1} x {grid.shape[1] - 1} quads")
    return given.out


if __name__ == "__main__":
    main()
