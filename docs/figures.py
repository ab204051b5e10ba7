"""Measure the figures of the README and write them there: `python docs/figures.py`. Takes a minute or two."""

import os
import time
from collections.abc import Sequence
from pathlib import Path

from drl_meshgen import MeshOptions, run
from drl_meshgen.models import MODELS

README = Path(__file__).resolve().parents[1] / "README.md"
MARKS = "<!-- figures -->\n", "<!-- end of figures -->\n"
COUNTS = 2000, 8000
COLUMNS = (
    "model",
    "quads",
    "angles",
    "warp",
    "area ratio",
    "orthogonality",
    "irregular",
    "blocks",
    "surface",
    "boundary",
)
"""Heads of the table; the last two are deviations."""


def line(cells: Sequence[str]) -> str:
    """Return one line of a table."""
    return f"| {' | '.join(cells)} |"


def row(model: str, quads: int) -> str:
    """Return one line of the table of quality."""
    m = run(model, MeshOptions().sized(quads))["quality"].metrics
    cells = (f"{m['quads']:,.0f}", f"{m['min_angle']:.1f} – {m['max_angle']:.1f}", f"{m['warp']:.1f}")
    cells += (f"{m['area_ratio']:.2f}", f"{m['orthogonality']:.3f}", f"{m['irregular']:.0f}")
    cells += (f"{m['named_blocks']:.0f}", f"{m['surface_deviation']:.4f}", f"{m['boundary_deviation']:.4f}")
    return line((model, *cells))


def quality() -> str:
    """Return the table of quality."""
    head = [line(COLUMNS), line(["---", *["---:"] * (len(COLUMNS) - 1)])]
    return "\n".join(head + [row(model, quads) for model in MODELS for quads in COUNTS])


def speed() -> str:
    """Return how long one mesh takes in a process that has done it before: no imports, no building of the model."""
    options = MeshOptions().sized(COUNTS[-1])
    run("giraffe", options)
    cpu = time.process_time()
    timings = run("giraffe", options).timings
    cpu = time.process_time() - cpu
    wall = sum(timing.seconds for timing in timings)
    shown = ", ".join(f"{timing.stage} {timing.seconds:.2f}" for timing in timings if timing.seconds >= 0.05)
    return (
        f"Giraffe, {COUNTS[-1]:,} quads: {wall:.1f} s by the clock, {cpu:.1f} s of one core ({shown}), "
        f"on {os.cpu_count()} cores with a load of {os.getloadavg()[0]:.1f}."
    )


def main() -> None:
    """Put both between their marks."""
    before, rest = README.read_text("utf-8").split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    README.write_text(f"{before}{MARKS[0]}\n{quality()}\n\n{speed()}\n\n{MARKS[1]}{after}", "utf-8")


if __name__ == "__main__":
    main()
