"""What every quick method makes of a domain: policies, value learners, Gmsh. One row per method, nothing is raised."""

import math
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from drl_meshgen.baselines.plane import PlaneMethod, plane_rivals
from drl_meshgen.benchmarks.record import Row
from drl_meshgen.errors import InputError
from drl_meshgen.rl.datasets import Sample
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.policies import SHIPPED, policy_named
from drl_meshgen.templates import Domain, OParameters, RulePolicy, instantiate

OURS = "ours"
POLICIES = {OURS: "agent", "rule": "rule", "gradient optimiser": "optimizer"}
"""Policies by their names in the tables."""
LEARNERS = {"Double DQN (the paper's)": "dqn", "Rainbow-type DQN": "rainbow", "PPO": "ppo"}
"""Value learners by their names in the tables; judged where there is a file of weights of that name."""
GMSH = tuple(method.value for method in PlaneMethod)
SQUARE = Domain(np.array([[i, 0] for i in range(6)] + [[6, i] for i in range(6)]
                         + [[6 - i, 6] for i in range(6)] + [[0, 6 - i] for i in range(6)], float))  # fmt: skip
"""What a policy meets first, so that loading and compiling are not timed."""

Choice = Callable[[Domain], OParameters]


@cache
def chooser(method: str, folder: Path) -> Choice | None:
    """Return what chooses parameters under a name of the tables; None where its weights are not there."""
    if method in LEARNERS:
        path = folder / f"{LEARNERS[method]}.safetensors"
        if not path.is_file():
            return None
        # imported here, as no other method needs the extra `rl`
        from drl_meshgen.rl.value.policy import load_value_policy

        policy = load_value_policy(path)
    elif method == OURS and not SHIPPED.is_file():
        return None
    else:
        policy = policy_named(POLICIES[method])
    policy.choose(SQUARE)
    return policy.choose


def judged(sample: Sample, folder: Path, methods: Sequence[str]) -> list[Row]:
    """Return a row per method: set, index, method, cause, metrics, milliseconds of CPU (of Gmsh: inside the mesher)."""
    rows = [row for method in methods if method not in GMSH for row in _chosen(sample, method, folder)]
    asked = [method for method in PlaneMethod if method.value in methods]
    corners = RulePolicy().choose(sample.domain).corners if PlaneMethod.TRANSFINITE in asked else np.arange(4)
    for method, made in (plane_rivals(sample.domain.nodes, corners, asked) if asked else {}).items():
        if len(made.quads):
            figures = plane_metrics(sample.domain, made.points, made.quads)
            rows.append(_row(sample, method.value, figures, 1000 * made.seconds))
        else:
            rows.append(_row(sample, method.value, {}, math.nan, made.outcome.value))
    return rows


def _chosen(sample: Sample, method: str, folder: Path) -> list[Row]:
    choose = chooser(method, folder)
    if choose is None:
        return []
    begin = time.process_time()
    try:
        parameters = choose(sample.domain)
    except InputError as error:
        return [_row(sample, method, {}, math.nan, str(error))]
    milliseconds = 1000 * (time.process_time() - begin)
    mesh = instantiate(sample.domain, parameters)
    return [
        _row(sample, method, plane_metrics(sample.domain, np.array(mesh.points), np.array(mesh.quads)), milliseconds)
    ]


def _row(sample: Sample, method: str, figures: dict[str, float], milliseconds: float, cause: str = "") -> Row:
    """Return a row; a method without a mesh has no figures, but its domain is not valid."""
    head = {"set": sample.set, "index": sample.index, "family": sample.family, "method": method, "cause": cause}
    return head | (figures or {"valid": 0.0}) | {"ms": milliseconds}
