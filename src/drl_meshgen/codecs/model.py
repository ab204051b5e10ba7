"""Files of the model stage: `raw.vtu`, the triangles as they came with their point arrays."""

from pathlib import Path

from drl_meshgen.codecs.files import Codec, read_facts, read_grid, write_facts, write_grid
from drl_meshgen.models.surface import RawSurface


def write(raw: RawSurface, folder: Path) -> None:
    """Write the raw surface and its name."""
    write_grid(folder / "raw.vtu", raw.points, raw.triangles, raw.point_data)
    write_facts(folder, name=raw.name)


def read(folder: Path) -> RawSurface:
    """Read the raw surface."""
    grid = read_grid(folder / "raw.vtu")
    return RawSurface(read_facts(folder).name, grid.points, grid.cells, grid.point)


MODEL = Codec(write, read, __name__)
