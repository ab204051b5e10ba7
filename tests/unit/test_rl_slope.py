import numpy as np
import pytest
import torch

from drl_meshgen.rl import DataSet, samples_of, twin
from drl_meshgen.rl.slope import worth_and_slope
from drl_meshgen.rl.worth import Worth
from drl_meshgen.templates import RulePolicy, instantiate
from drl_meshgen.templates.score import Weights

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
QUAD = np.array([[0, 1, 2, 3]])


def from_twin(points, quads, share=None, weights=None):
    at = torch.tensor(points, requires_grad=True)
    quads = torch.as_tensor(np.array(quads))
    share = None if share is None else torch.as_tensor(share)
    value = twin.reward(at, quads, share, weights) - twin.validity_penalty(at, quads, share)
    return value.detach().numpy(), torch.autograd.grad(value.sum(), at)[0].numpy()


@pytest.mark.parametrize("noise", [0.1, 0.4, 1.0])
def test_value_and_gradient_of_single_quads_are_those_of_the_twin(noise):
    points = SQUARE + np.random.default_rng(0).normal(0, noise, (60, 4, 2))
    for weights in (None, Weights(0.7, 0.3, 0.2, 0.8)):
        value, slope = worth_and_slope(points, QUAD, weights=weights)
        expected = from_twin(points, QUAD, weights=weights)
        assert value == pytest.approx(expected[0], abs=1e-12)
        assert slope == pytest.approx(expected[1], abs=1e-9)


def test_value_and_gradient_of_meshes_are_those_of_the_twin():
    rng = np.random.default_rng(1)
    for sample in samples_of(DataSet.TEST_HARD, range(2)):
        mesh = instantiate(sample.domain, RulePolicy().choose(sample.domain))
        points = np.array(mesh.points) + rng.normal(0, 0.01, (3, *mesh.points.shape))
        share = rng.dirichlet(np.ones(len(mesh.quads)), 3)
        value, slope = worth_and_slope(points, np.array(mesh.quads), share)
        expected = from_twin(points, mesh.quads, share)
        assert value == pytest.approx(expected[0], abs=1e-11)
        assert slope == pytest.approx(expected[1], abs=1e-9)


def test_pytorch_gets_the_same_gradient():
    points = torch.tensor(SQUARE + np.random.default_rng(2).normal(0, 0.1, (3, 4, 2)), requires_grad=True)
    worth = Worth.apply(points, torch.as_tensor(QUAD), torch.ones(1, 1, dtype=torch.float64), Weights())
    (slope,) = torch.autograd.grad((worth * torch.tensor([1.0, 2.0, 0.0])).sum(), points)
    plain = worth_and_slope(points.detach().numpy(), QUAD)[1]
    assert slope.numpy() == pytest.approx(plain * np.array([1.0, 2.0, 0.0])[:, None, None])
