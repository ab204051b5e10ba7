"""Ablation of the reward (paper Table 1, Fig. 10): learners whose boundary nodes may leave the samples.

Where mesh and boundary share their nodes, as in all else here, the fit is exact and its weight says nothing. Here a
mesh may also displace its boundary nodes, by sines along each side, and pays for it by eq. 14.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import pandas as pd
import torch
import typer
from jaxtyping import Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.export import write_table
from drl_meshgen.rl.agent import AgentOptions, AgentPolicy
from drl_meshgen.rl.boundary import PER_SIDE, side_samples
from drl_meshgen.rl.console import run
from drl_meshgen.rl.controls import FREED
from drl_meshgen.rl.datasets import DataSet, Sample, samples_of
from drl_meshgen.rl.learning import Bank, Learner, LearnOptions
from drl_meshgen.rl.networks import load, weights_of
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.policy_file import read_policy, read_weights
from drl_meshgen.rl.scene import Scene
from drl_meshgen.rl.surrogate import Surrogate
from drl_meshgen.rl.train import drawn
from drl_meshgen.templates import Domain, OParameters, TemplateMesh, instantiate
from drl_meshgen.templates.curves import SWELLS, sines
from drl_meshgen.templates.score import Weights, boundary_mse

REWARDS: Final = {
    "quality": Weights(quality=1.0, fidelity=0.0),
    "fitting": Weights(quality=0.0, fidelity=1.0),
    "full": Weights(),
}
"""Rewards of Table 1."""
ANGLE_WEIGHTS: Final = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Weights of orthogonality of Fig. 10."""


def displaced(
    nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "2"], rim: Float[np.ndarray, "4 3 2"]
) -> Float[np.ndarray, "l 2"]:
    """Return boundary nodes moved by sines along each side between the corners `(i0, m)`."""
    i0, m = corners
    counts = np.array([m, len(nodes) // 2 - m] * 2)
    moves = [sines(np.arange(count) / count, SWELLS) @ wave for count, wave in zip(counts, rim, strict=True)]
    return nodes + np.roll(np.concatenate(moves), i0, axis=0)


class FreeLearner(Learner):
    """A learner of meshes whose boundary nodes are free; the weights are those of its options."""

    def worth(
        self,
        coarse: Surrogate,
        rim: Float[torch.Tensor, "b r 2"],
        parts: Mapping[str, torch.Tensor],
        share: Float[torch.Tensor, "b q"],
    ) -> Float[torch.Tensor, " b"]:
        """Return the worth of the quads less the misfit of the rim."""
        waves = torch.as_tensor(sines(np.arange(coarse.divisions) / coarse.divisions, SWELLS))
        moved = (waves @ parts["rim"]).flatten(1, 2)
        inner = {name: part for name, part in parts.items() if name != "rim"}
        misfit = moved.square().sum(dim=-1).mean(dim=-1) / self.spacing(rim) ** 2
        return super().worth(coarse, rim + moved, inner, share) - self.options.weights.fidelity * misfit

    def exact(
        self,
        nodes: Float[np.ndarray, "l 2"],
        corners: Int[np.ndarray, "1 2"],
        layers: Int[np.ndarray, "1"],
        parts: Mapping[str, np.ndarray],
    ) -> float:
        """Return the reward of one mesh less its penalty."""
        moved = displaced(nodes, corners[0], parts["rim"][0])
        inner = {name: part for name, part in parts.items() if name != "rim"}
        spacing = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1).mean()
        misfit = boundary_mse(moved, nodes) / spacing**2
        return super().exact(moved, corners, layers, inner) - self.options.weights.fidelity * float(misfit)

    def spacing(self, rim: Float[torch.Tensor, "b r 2"]) -> Float[torch.Tensor, " b"]:
        """Return the mean spacing of a boundary of 100 nodes with these samples."""
        return (torch.roll(rim, -1, dims=1) - rim).norm(dim=-1).sum(dim=1) / 100

    def best(self, domain: Domain) -> TemplateMesh:
        """Return the mesh of most worth among the most valuable choices of corners, in the domain's frame.

        A mesh whose boundary crosses itself is none; raises `InputError` where all are so.
        """
        nodes = domain.frame.to_local(domain.nodes)
        policy, k = self.policy(), self.options.nominal
        pairs = policy.corners([nodes], policy.options.tried)[0]
        rim = side_samples(np.ascontiguousarray(nodes)[None], pairs, PER_SIDE)
        scene = Scene.of(rim, pairs[:, 1], len(nodes), k)
        parts = scene.placed(policy.placement(scene.seen))
        some = [{name: part[b : b + 1] for name, part in parts.items()} for b in range(len(pairs))]
        worth = [self.exact(nodes, pairs[b : b + 1], np.array([k]), some[b]) for b in range(len(pairs))]
        for b in np.argsort(worth)[::-1]:
            one = {name: part[0] for name, part in some[b].items()}
            i0, m = pairs[b].tolist()
            try:
                moved = Domain(displaced(nodes, pairs[b], one.pop("rim")))
            except InputError:  # its boundary crosses itself
                continue
            return instantiate(moved, OParameters(i0, m, len(nodes) // 2 - m, k, **one))
        raise InputError("ablation", "every boundary crosses itself")


def ablated(bank: Bank, steps: int, seed: int) -> Iterator[dict[str, Any]]:
    """Train with every reward of Table 1; yield metrics of Test-Standard."""
    for name, weights in REWARDS.items():
        learner = FreeLearner(bank, LearnOptions(seed=seed, steps=steps, polish=0, answered=FREED, weights=weights))
        for _ in range(steps):
            learner.advance()
        for sample in samples_of(DataSet.TEST_STANDARD):
            local = Domain(sample.domain.frame.to_local(sample.domain.nodes))
            yield {"configuration": name} | _row(sample, local, learner.best(local))


def front(bank: Bank, start: Mapping[str, np.ndarray], steps: int, seed: int) -> Iterator[dict[str, Any]]:
    """Train the policy on with every weight of Fig. 10; yield metrics of Test-Standard."""
    for share in ANGLE_WEIGHTS:
        weights = replace(Weights(), orthogonality=share, jacobian=1 - share)
        learner = Learner(bank, LearnOptions(seed=seed, steps=steps, polish=0, rate=3e-4, weights=weights))
        load(learner.networks, start)
        for _ in range(steps):
            learner.advance()
        policy = AgentPolicy(weights_of(learner.networks), AgentOptions(weights=weights))
        for sample in samples_of(DataSet.TEST_STANDARD):
            yield {"w_orth": share} | _row(
                sample, sample.domain, instantiate(sample.domain, policy.choose(sample.domain))
            )


def stages(folder: Path, index: int) -> Iterator[dict[str, Any]]:
    """Yield what the policy chooses for a training domain, early and late in training (Table 2, Fig. 11)."""
    (sample,) = samples_of(DataSet.TRAIN, [index])
    for stage, name in (("early", "early"), ("late", "agent")):
        p = read_policy(folder / f"{name}.safetensors", AgentOptions(tried=1)).choose(sample.domain)
        lists = {key: getattr(p, key).ravel().tolist() for key in ("singular", "bulges", "waves", "swells")}
        whole = {"i0": p.i0, "m": p.m, "n": p.n, "layers": p.layers, "grading": p.grading}
        yield {"stage": stage, "set": sample.set, "index": sample.index} | whole | lists


def _row(sample: Sample, domain: Domain, mesh: TemplateMesh) -> dict[str, Any]:
    metrics = plane_metrics(domain, np.array(mesh.points), np.array(mesh.quads))
    return {"set": sample.set, "index": sample.index} | metrics


def ablate(  # noqa: PLR0917 - options of a command
    trained: Annotated[Path, typer.Option(help="Folder that training wrote to.")] = Path("out/train"),
    out: Annotated[Path, typer.Option(help="Folder of the tables.")] = Path("docs/benchmarks/rl"),
    steps: Annotated[int, typer.Option(min=1, help="Steps of each learner of Table 1.")] = 1000,
    tuned: Annotated[int, typer.Option(min=1, help="Steps by which the policy is trained on for Fig. 10.")] = 250,
    index: Annotated[int, typer.Option(min=0, help="Training domain of Table 2 and Fig. 11.")] = 4,
    seed: Annotated[int, typer.Option(help="Seed of weights and draws.")] = LearnOptions.seed,
) -> None:
    """Write `ablation.parquet`, `pareto.parquet` and `stages.parquet`."""
    torch.set_num_threads(1)
    path = trained / "domains.parquet"
    bank = Bank(*drawn(path, (DataSet.TRAIN, DataSet.TRAIN_HARD), DataSet.TRAIN.size).values())
    write_table(out / "stages.parquet", pd.DataFrame(stages(trained, index)))
    start = read_weights(trained / "agent.safetensors")
    write_table(out / "pareto.parquet", pd.DataFrame(front(bank, start, tuned, seed)))
    write_table(out / "ablation.parquet", pd.DataFrame(ablated(bank, steps, seed)))
    typer.echo(out)


if __name__ == "__main__":
    run(ablate)
