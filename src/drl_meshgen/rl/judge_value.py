"""Judge trained value policies on both test sets: `python -m drl_meshgen.rl.judge_value FILE... --out DIR`.

Writes `scores.{parquet,csv}`, a row per policy and domain, and, apart because no two runs take the same time,
`scores-ms.csv`.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from drl_meshgen.export import write_table
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl.console import code_of
from drl_meshgen.rl.datasets import DataSet, Sample, samples_of
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.value.policy import ValuePolicy, load_value_policy

TESTS = (DataSet.TEST_STANDARD, DataSet.TEST_HARD)
TOGETHER = 64
"""Domains that are meshed side by side when that is timed."""
FIGURES = ("reward", "orthogonality", "jacobian", "valid")


def scores(policy: ValuePolicy, samples: Sequence[Sample]) -> pd.DataFrame:
    """Return a row per domain: set, index, family, reward without penalty, orthogonality, jacobian, valid.

    Orthogonality is that of the worst corner. Folded meshes keep the reward they have by definition.
    """
    rows = []
    for one in samples:
        p = policy.choose(one.domain)
        corners, layers = np.array([[p.i0, p.m]]), np.array([p.layers])
        judged = judge_o(one.domain.nodes, corners, layers, p.singular[None], p.bulges[None])
        values = (judged.reward, judged.orthogonality, judged.jacobian, judged.valid)
        rows.append([one.set, one.index, one.family, *(value[0] for value in values)])
    return pd.DataFrame(rows, columns=["set", "index", "family", *FIGURES])


def milliseconds(policy: ValuePolicy, samples: Sequence[Sample]) -> dict[str, float]:
    """Return CPU time per domain, one by one and `TOGETHER` side by side."""
    domains = [one.domain for one in samples[:TOGETHER]]

    def spent(act: Callable[[], object]) -> float:
        before = time.process_time()
        act()
        return 1000 * (time.process_time() - before) / len(domains)

    single, together = (lambda: [policy.choose(one) for one in domains]), (lambda: policy.choose_all(domains))
    together()  # compiles and loads what the first call does
    return {"ms_single": spent(single), "ms_together": spent(together)}


def main(arguments: list[str] | None = None) -> int:
    """Judge policies, write the tables and print their means."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.rl.judge_value", description=__doc__)
    parser.add_argument("policies", type=Path, nargs="+", metavar="FILE", help="NAME.safetensors")
    parser.add_argument("--out", type=Path, default=Path("out/rl"), metavar="DIR")
    parser.add_argument("--domains", type=int, metavar="N", help="only the first N domains of each set")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    tables, times = [], []
    for path in given.policies:
        policy = load_value_policy(path)
        for data in TESTS:
            samples = list(samples_of(data, range(min(data.size, given.domains or data.size))))
            tables.append(scores(policy, samples).assign(policy=path.stem))
            times.append({"policy": path.stem, "set": data.key} | milliseconds(policy, samples))
    table = pd.concat(tables, ignore_index=True).reindex(columns=["policy", "set", "index", "family", *FIGURES])
    write_table(given.out / "scores.parquet", table)
    with replacing(given.out / "scores.csv") as part:
        table.round(6).to_csv(part, index=False)
    with replacing(given.out / "scores-ms.csv") as part:
        pd.DataFrame(times).round(2).to_csv(part, index=False)
    means = table.pivot_table(index=["policy", "set"], values=list(FIGURES), aggfunc="mean", sort=False)
    print(means.round(3).to_string())  # noqa: T201
    print(pd.DataFrame(times).round(2).to_string(index=False))  # noqa: T201
    return 0


if __name__ == "__main__":
    raise SystemExit(code_of(main))
