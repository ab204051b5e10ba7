"""Files of the partition stage.

`surface.vtu`: the cut surface with point arrays `depth`, `contour` and cell arrays `region`, `parent`.
`curves.parquet`, `regions.parquet`: what the contours are and what they leave. `merges.parquet`, `isovalues.parquet`:
how they were chosen.
"""

from pathlib import Path

from drl_meshgen.codecs.files import (
    Codec,
    integers,
    read_facts,
    read_grid,
    read_rows,
    seams_of,
    sewn_to,
    write_facts,
    write_grid,
    write_rows,
)
from drl_meshgen.export import read_table, write_table
from drl_meshgen.partition import Curve, CutSurface, Outcome, Partition, Region, RegionKind


def write(result: Partition, folder: Path) -> None:
    """Write regions, curves and the tables of the join tree."""
    cut = result.surface
    write_grid(
        folder / "surface.vtu",
        cut.mesh.vertices,
        cut.mesh.triangles,
        {"depth": cut.depth, "contour": cut.contour},
        {"region": result.region, "parent": cut.parent},
    )
    write_rows(
        folder / "curves.parquet",
        curve=range(len(result.curves)),
        level=[c.level for c in result.curves],
        is_boundary=[c.is_boundary for c in result.curves],
        sewn_to=sewn_to(result.seams, len(result.curves)),
        vertices=[c.vertices for c in result.curves],
    )
    write_rows(
        folder / "regions.parquet",
        region=range(len(result.regions)),
        kind=[r.kind.name for r in result.regions],
        euler=[r.euler for r in result.regions],
        loops=[r.loops for r in result.regions],
    )
    write_table(folder / "merges.parquet", result.merges)
    write_table(folder / "isovalues.parquet", result.isovalues)
    write_facts(folder, outcome=result.outcome.name)


def read(folder: Path) -> Partition:
    """Read regions, curves and the tables of the join tree."""
    grid = read_grid(folder / "surface.vtu")
    curves = read_rows(folder / "curves.parquet")
    regions = read_rows(folder / "regions.parquet")
    return Partition(
        CutSurface(grid.surface, grid.point["depth"], grid.cell["parent"], grid.point["contour"]),
        tuple(Curve(integers(c.vertices), c.is_boundary, c.level) for c in curves),
        grid.cell["region"],
        tuple(Region(RegionKind[r.kind], tuple(integers(r.loops).tolist()), r.euler) for r in regions),
        read_table(folder / "merges.parquet"),
        read_table(folder / "isovalues.parquet"),
        Outcome[read_facts(folder).outcome],
        seams_of([c.sewn_to for c in curves]),
    )


PARTITION = Codec(write, read, __name__)
