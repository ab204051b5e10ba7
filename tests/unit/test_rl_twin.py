import numpy as np
import pytest
import torch

from drl_meshgen.rl import DataSet, samples_of, twin
from drl_meshgen.templates import RulePolicy, instantiate, score

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
QUAD = np.array([[0, 1, 2, 3]])


def both(points, quads, weights=None):
    mine = twin.reward(torch.as_tensor(points), torch.as_tensor(quads), weights=weights)
    return mine.numpy(), score.reward(points, quads, weights=weights)


@pytest.mark.parametrize("data", [DataSet.TEST_STANDARD, DataSet.TEST_HARD])
def test_both_rewards_are_the_same_on_o_type_meshes(data):
    for sample in samples_of(data, range(4)):
        mesh = instantiate(sample.domain, RulePolicy().choose(sample.domain))
        mine, theirs = both(np.array(mesh.points), np.array(mesh.quads))
        assert mesh.valid or data is DataSet.TEST_HARD
        assert mine == pytest.approx(theirs, abs=1e-9)


def test_both_rewards_are_the_same_on_folded_quads_and_for_other_weights():
    batch = SQUARE + np.random.default_rng(0).normal(0, 0.5, (50, 4, 2))
    mine, theirs = both(batch, QUAD, score.Weights(0.5, 0.5, 0.9, 0.1))
    assert mine == pytest.approx(theirs, abs=1e-9)
    assert (score.jacobians(batch, QUAD) < 0).any()


def test_both_penalties_are_the_same():
    batch = SQUARE + np.random.default_rng(3).normal(0, 0.4, (50, 4, 2))
    mine = twin.validity_penalty(torch.as_tensor(batch), torch.as_tensor(QUAD)).numpy()
    assert mine == pytest.approx(score.validity_penalty(batch, QUAD), abs=1e-9)


def test_the_gradient_is_that_of_differences():
    points = torch.tensor(SQUARE + np.random.default_rng(1).normal(0, 0.1, (4, 2)), requires_grad=True)
    quads = torch.as_tensor(QUAD)
    total = twin.reward(points, quads) - twin.validity_penalty(points, quads)
    (slope,) = torch.autograd.grad(total, points)
    step = 1e-6
    for k in np.ndindex(4, 2):
        ends = []
        for sign in (1, -1):
            moved = points.detach().clone()
            moved[k] += sign * step
            ends.append(float(twin.reward(moved, quads) - twin.validity_penalty(moved, quads)))
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(float(slope[k]), abs=1e-6)


def test_the_penalty_pulls_folded_quads_apart_and_leaves_others_alone():
    folded = torch.tensor([[0.0, 0], [1, 0], [0.2, 0.2], [0, 1]], dtype=torch.float64, requires_grad=True)
    quads = torch.as_tensor(QUAD)
    penalty = twin.validity_penalty(folded, quads)
    (slope,) = torch.autograd.grad(penalty, folded)
    assert float(penalty.detach()) > 1
    assert (slope[2] < 0).all()  # further out is better
    assert float(twin.validity_penalty(torch.as_tensor(SQUARE), quads)) == 0


def test_shares_weigh_the_quads():
    points = torch.as_tensor(SQUARE + np.random.default_rng(2).normal(0, 0.1, (3, 4, 2))).reshape(-1, 2)
    quads = torch.arange(12).reshape(3, 4)
    even = torch.full((3,), 1 / 3, dtype=torch.float64)
    assert float(twin.reward(points, quads, even)) == pytest.approx(float(twin.reward(points, quads)))
    first = torch.tensor([1.0, 0, 0], dtype=torch.float64)
    assert float(twin.reward(points, quads, first)) == pytest.approx(float(twin.reward(points, quads[:1])))
