"""How quality follows the number of quads: `python docs/gallery/compare_counts.py giraffe 1000 2000 4000 8000`.

Cleanup, seams, flow and sizes are the same for all counts, so a store computes them once.
"""

import argparse
import tempfile

import pandas as pd

from drl_meshgen import MeshOptions, run
from drl_meshgen.store import Store

SHOWN = (
    "quads", "named_blocks", "blocks", "irregular", "min_angle", "max_angle", "warp", "area_ratio", "orthogonality",
    "surface_deviation", "boundary_deviation",
)  # fmt: skip


def main(arguments: list[str] | None = None) -> pd.DataFrame:
    """Print and return a row of metrics per count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", help="model name or file")
    parser.add_argument("quads", nargs="+", type=int)
    parser.add_argument("--triangles", type=int, default=25_000)
    given = parser.parse_args(arguments)

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for quads in given.quads:
            done = run(given.source, MeshOptions().sized(quads), triangles=given.triangles, store=Store(folder))
            metrics = done["quality"].metrics
            reused = sum(timing.cached for timing in done.timings)
            rows.append({"wanted": quads, **{name: metrics[name] for name in SHOWN}, "reused stages": reused})
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="{:.4g}".format))
    return table


if __name__ == "__main__":
    main()
