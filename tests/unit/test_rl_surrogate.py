import numpy as np
import pytest
import torch

from drl_meshgen.quality.metrics import line_smoothness
from drl_meshgen.rl import DataSet, samples_of, twin
from drl_meshgen.rl.boundary import side_samples
from drl_meshgen.rl.surrogate import Surrogate
from drl_meshgen.templates import Domain, OParameters, RulePolicy, instantiate, score


def even_square(cells):
    side, zero = np.arange(cells) / cells, np.zeros(cells)
    return Domain(
        np.concatenate([np.c_[side, zero], np.c_[zero + 1, side], np.c_[1 - side, zero + 1], np.c_[zero, 1 - side]])
    )


def rim_of(coarse, domain, i0, m):
    return torch.as_tensor(side_samples(domain.nodes[None], np.array([[i0, m]]), coarse.divisions))


def test_it_is_the_template_itself_where_cells_agree():
    domain, rng = even_square(6), np.random.default_rng(0)
    singular = np.array([[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]]) + rng.uniform(-0.05, 0.05, (4, 2))
    bulges = rng.uniform(-0.1, 0.1, (8, 2))
    waves, swells = rng.uniform(-0.02, 0.02, (8, 2, 2)), rng.uniform(-0.02, 0.02, (4, 3, 2))
    mesh = instantiate(domain, OParameters(0, 6, 6, 3, singular, bulges, waves=waves, swells=swells))
    coarse = Surrogate(6, 3)
    rim = rim_of(coarse, domain, 0, 6)
    controls = [torch.as_tensor(part)[None] for part in (singular, bulges, waves, swells)]
    points = coarse.points(rim, *controls)[0].numpy()
    at = [np.linalg.norm(mesh.points - point, axis=1).min() for point in points]
    assert max(at) < 1e-12
    assert len(points) == len(mesh.points)
    share = coarse.share(*(torch.tensor([k]) for k in (6, 6, 3)))
    mine = twin.reward(torch.as_tensor(points), coarse.quads, share[0])
    assert float(mine) == pytest.approx(float(score.reward(np.array(mesh.points), np.array(mesh.quads))))


def test_with_as_many_cells_its_reward_is_that_of_the_fine_mesh():
    coarse = Surrogate(20, 8)
    for sample in samples_of(DataSet.TEST_STANDARD, range(6)):
        found = RulePolicy().choose(sample.domain)
        plain = OParameters(found.i0, found.m, found.n, found.layers, found.singular, found.bulges)
        mesh = instantiate(sample.domain, plain)
        rim = rim_of(coarse, sample.domain, found.i0, found.m)
        points = coarse.points(
            rim, torch.as_tensor(np.array(found.singular))[None], torch.as_tensor(np.array(found.bulges))[None]
        )
        share = coarse.share(*(torch.tensor([k]) for k in (found.m, found.n, found.layers)))
        mine = float(twin.reward(points, coarse.quads, share)[0])
        assert mine == pytest.approx(float(score.reward(np.array(mesh.points), np.array(mesh.quads))), abs=0.015)


def test_shares_sum_to_one():
    share = Surrogate(5, 2).share(torch.tensor([10, 20]), torch.tensor([40, 30]), torch.tensor([3, 10]))
    assert share.sum(dim=1).numpy() == pytest.approx([1, 1])
    assert share.shape == (2, 5 * 5 + 4 * 5 * 2)


def test_a_gradient_reaches_every_control():
    coarse, sample = Surrogate(), next(samples_of(DataSet.TEST_STANDARD))
    found = RulePolicy().choose(sample.domain)
    rim = rim_of(coarse, sample.domain, found.i0, found.m)
    singular = torch.tensor(np.array(found.singular))[None].requires_grad_()
    bulges = torch.zeros(1, 8, 2, dtype=torch.float64, requires_grad=True)
    twin.reward(coarse.points(rim, singular, bulges), coarse.quads).sum().backward()
    assert (singular.grad != 0).all()
    assert (bulges.grad != 0).any(dim=2).all()


def smoothness_of(coarse, rim, singular, counts):
    controls = [torch.as_tensor(np.array(part))[None] for part in (singular, np.zeros((8, 2)))]
    return float(coarse.smoothness(coarse.points(rim, *controls), *(torch.tensor([k]) for k in counts))[0])


def test_smoothness_is_one_on_an_even_grid_and_that_of_the_template_where_cells_agree():
    domain, coarse = even_square(6), Surrogate(6, 2)
    rim = rim_of(coarse, domain, 0, 6)
    # rows of the outer blocks end at corners, so an O-grid is never all even; its core here is
    singular = np.array([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
    mesh = instantiate(domain, OParameters(0, 6, 6, 2, singular, np.zeros((8, 2))))
    mine = smoothness_of(coarse, rim, singular, (6, 6, 2))
    assert mine == pytest.approx(line_smoothness(mesh.blocks.mesh)[0], abs=0.01)
    assert smoothness_of(coarse, rim, 0.2 * (singular - 0.5) + 0.5, (6, 6, 2)) < mine


@pytest.mark.parametrize("index", [0, 3])
def test_smoothness_is_about_that_of_the_fine_mesh(index):
    coarse, (sample,) = Surrogate(12, 3), samples_of(DataSet.TEST_STANDARD, [index])
    found = RulePolicy().choose(sample.domain, layers=3)
    plain = OParameters(found.i0, found.m, found.n, 3, found.singular, np.zeros((8, 2)))
    rim = rim_of(coarse, sample.domain, found.i0, found.m)
    mine = smoothness_of(coarse, rim, found.singular, (found.m, found.n, 3))
    fine = line_smoothness(instantiate(sample.domain, plain).blocks.mesh)[0]
    assert mine == pytest.approx(fine, abs=0.02)
