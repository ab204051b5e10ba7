"""Draw domains of every set on one sheet: `python docs/gallery/domains.py docs/benchmarks/rl --out domains.png`."""

import argparse
from pathlib import Path

from drl_meshgen.benchmarks.rl_figures import draw_sets


def main(arguments: list[str] | None = None) -> Path:
    """Write the sheet; return its path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/benchmarks/rl"), help="has test-pipeline")
    parser.add_argument("--out", type=Path, default=Path("out/gallery/domains.png"), metavar="FILE.png")
    parser.add_argument("--rows", type=int, default=4, help="rows of each set")
    parser.add_argument("--columns", type=int, default=12)
    given = parser.parse_args(arguments)

    drawn = draw_sets(given.folder, given.out, rows=given.rows, columns=given.columns)
    print(drawn.caption)
    return given.out


if __name__ == "__main__":
    main()
