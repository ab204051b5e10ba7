"""Files of the sizing stage: `surface.vtu` with point arrays `factor`, `wanted` and `most`, and the gradation."""

from pathlib import Path

from drl_meshgen.codecs.files import Codec, read_facts, read_grid, write_facts, write_grid
from drl_meshgen.sizing import SizeField


def write(result: SizeField, folder: Path) -> None:
    """Write the wanted sizes."""
    arrays = {"factor": result.factor, "wanted": result.wanted, "most": result.most}
    write_grid(folder / "surface.vtu", result.surface.vertices, result.surface.triangles, arrays)
    write_facts(folder, gradation=result.gradation)


def read(folder: Path) -> SizeField:
    """Read the wanted sizes."""
    grid = read_grid(folder / "surface.vtu")
    point = grid.point
    return SizeField(grid.surface, point["factor"], point["wanted"], point["most"], read_facts(folder).gradation)


SIZING = Codec(write, read, __name__)
