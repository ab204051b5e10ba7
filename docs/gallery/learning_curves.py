"""Draw the learning curves of value policies: `python docs/gallery/learning_curves.py docs/benchmarks/rl`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

from drl_meshgen.export import read_table, replacing

NAMES = {"dqn": "the paper's Double DQN", "rainbow": "Rainbow-type DQN", "ppo": "PPO with masks"}


def main(arguments: Sequence[str] | None = None) -> Path:
    """Draw `curve-*.parquet` of a folder into its `curves.png`; return its path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs/benchmarks/rl"))
    folder = parser.parse_args(arguments).folder
    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for name, label in NAMES.items():
        if (path := folder / f"curve-{name}.parquet").exists():
            curve = read_table(path)
            left.plot(curve["steps"] / 1000, curve["mean_return"], label=label)
            right.plot(curve["steps"] / 1000, 100 * curve["valid"], label=label)
    left.set(ylabel="mean return on validation domains", ylim=(-0.3, 0.8))
    right.set(ylabel="valid meshes, %", ylim=(0, 100))
    for axes in (left, right):
        axes.set(xlabel="environment steps, thousands")
        axes.grid(alpha=0.3)
    left.legend()
    with replacing(folder / "curves.png") as part:
        figure.savefig(part, dpi=110)
    plt.close(figure)
    return folder / "curves.png"


if __name__ == "__main__":
    main()
