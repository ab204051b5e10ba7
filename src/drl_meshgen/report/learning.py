"""One page about templates chosen by learning: tables and figures in one file, in the look of the report."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from drl_meshgen.export import replacing

TITLE = "Templates chosen by learning"


@dataclass(frozen=True, eq=False)
class ShownTable:
    """A table as it is printed."""

    key: str
    """Short name."""
    title: str
    """Heading."""
    note: str
    """What it shows."""
    head: tuple[str, ...]
    """Heads of all columns."""
    groups: tuple[tuple[str, tuple[tuple[str, ...], ...]], ...]
    """Groups of rows by their names; cells as they are printed."""
    best: frozenset[tuple[str, int, int]] = frozenset()
    """Group, row and column of the best figures."""


@dataclass(frozen=True)
class ShownFigure:
    """A picture with its words."""

    title: str
    """Heading."""
    caption: str
    """What it shows."""
    path: Path
    """PNG file."""

    @property
    def data(self) -> str:
        """The picture as it stands in the page."""
        return "data:image/png;base64," + base64.b64encode(self.path.read_bytes()).decode("ascii")


def build_learning_report(
    folder: Path | str, tables: Sequence[ShownTable], figures: Sequence[ShownFigure], ours: str
) -> Path:
    """Write `report.html` into a folder; returns its path. The page needs no other file; `ours` is the row to mark."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("learning.html.j2")
    path = Path(folder) / "report.html"
    with replacing(path) as part:
        part.write_text(page.render(title=TITLE, tables=tables, figures=figures, ours=ours), encoding="utf-8")
    return path
