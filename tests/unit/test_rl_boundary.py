import numpy as np
import pytest
import torch

from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.boundary import CONTROL_SIGNS, CONTROLS, SAMPLE_SIGNS, SAMPLES, side_samples, square_frame
from drl_meshgen.rl.controls import SHAPED
from drl_meshgen.rl.inference import CornerValues, Placements
from drl_meshgen.rl.networks import CornerValue, Placer, weights_of
from drl_meshgen.rl.scene import Scene, corner_choices, views
from drl_meshgen.rl.symmetry import of_square
from drl_meshgen.templates import Domain, OParameters, instantiate

TURN = np.array([[0.6, 0.8], [-0.8, 0.6]])
MIRROR = np.array([-1.0, 1.0])


@pytest.fixture(scope="module")
def nodes():
    return next(samples_of(DataSet.TEST_HARD, [3])).domain.nodes


@pytest.fixture(scope="module")
def placer():
    torch.manual_seed(0)
    made = Placer(of_square(SHAPED), 32)
    torch.nn.init.normal_(made.body[-1].weight, 0, 0.1)
    torch.nn.init.normal_(made.body[-1].bias, 0, 0.1)
    return made


@pytest.fixture(scope="module")
def corner():
    torch.manual_seed(1)
    return CornerValue(32)


def placed(placer, nodes, i0, m):
    rim = side_samples(nodes[None], np.array([[i0 % len(nodes), m]]), 16)
    scene = Scene.of(rim, np.array([m]), len(nodes), 5).each(torch.as_tensor)
    return {name: part[0].detach().numpy() for name, part in scene.placed(placer(scene.seen), torch.tanh).items()}


def valued(corner, nodes, four):
    return corner(torch.as_tensor(views(nodes[None])), torch.as_tensor(four)[None])[0].detach().numpy()


def test_samples_begin_at_the_corners_and_are_evenly_spaced_along_each_side(nodes):
    i0, m = 17, 22
    rim = side_samples(nodes[None], np.array([[i0, m]]), 4)[0]
    n = len(nodes) // 2 - m
    assert rim[::4] == pytest.approx(nodes[(i0 + np.array([0, m, m + n, 2 * m + n])) % len(nodes)])
    straight = np.array([[0.0, 0], [1, 0], [3, 0], [3, 1], [3, 3], [1, 3], [0, 3], [0, 2]])
    assert side_samples(straight[None], np.array([[0, 2]]), 3)[0][:6] == pytest.approx(
        np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2]])
    )


def test_the_frame_of_a_square_is_its_own():
    square = np.exp(1j * np.pi / 4 * np.array([-3, -1, 1, 3]))[None] * np.exp(0.3j) * 2 + 1
    origin, direction = square_frame(square)
    assert (origin[0, 0], direction[0, 0]) == pytest.approx((1, np.exp(0.3j)))


def test_the_symmetries_are_signed_permutations_that_undo_one_another():
    for columns, signs in ((SAMPLES, SAMPLE_SIGNS), (CONTROLS, CONTROL_SIGNS)):
        assert (np.sort(columns, axis=1) == np.arange(columns.shape[1])).all()
        assert (np.abs(signs) == 1).all()
        seen = {tuple(c) + tuple(s) for c, s in zip(columns.tolist(), signs.tolist(), strict=True)}
        assert len(seen) == 8


def test_naming_another_corner_first_gives_the_same_placement(nodes, placer):
    m, n = 20, len(nodes) // 2 - 20
    one, two = placed(placer, nodes, 5, m), placed(placer, nodes, 5 + m, n)
    for name in ("singular", "swells"):
        assert two[name] == pytest.approx(np.roll(one[name], -1, axis=0), abs=1e-6)
    for name in ("bulges", "waves"):
        spokes, sides = np.roll(one[name][:4], -1, axis=0), np.roll(one[name][4:], -1, axis=0)
        assert two[name] == pytest.approx(np.concatenate([spokes, sides]), abs=1e-6)
        assert np.abs(one[name]).max() > 0.01


def test_a_turned_and_moved_domain_gets_a_turned_placement(nodes, placer):
    one, two = placed(placer, nodes, 5, 20), placed(placer, nodes @ TURN + 3, 5, 20)
    assert two["singular"] == pytest.approx(one["singular"] @ TURN + 3, abs=1e-6)
    assert two["bulges"] == pytest.approx(one["bulges"], abs=1e-6)
    for name in ("waves", "swells"):
        assert two[name] == pytest.approx(one[name] @ TURN, abs=1e-6)


def test_the_mirrored_domain_gets_the_mirrored_mesh(nodes, placer):
    m, n = 20, len(nodes) // 2 - 20
    domain, mirror = Domain(nodes), Domain((nodes * MIRROR)[::-1])
    there = (len(nodes) - 1 - (5 + m)) % len(nodes)
    one = instantiate(domain, OParameters(5, m, n, 5, **placed(placer, nodes, 5, m)))
    two = instantiate(mirror, OParameters(there, m, n, 5, **placed(placer, mirror.nodes, there, m)))
    distance = np.abs(two.points[:, None] - one.points * MIRROR).max(axis=-1)
    assert distance.min(axis=0).max() < 1e-6
    assert distance.min(axis=1).max() < 1e-6


def test_before_training_the_placement_is_tuttes_with_straight_lines():
    even = np.linspace(-1, 1, 16, endpoint=False)
    one = np.ones(16)
    square = np.concatenate([np.c_[even, -one], np.c_[one, even], np.c_[-even, one], np.c_[-one, -even]])
    found = placed(Placer(of_square(SHAPED), 8), square, 0, 16)
    middle = found.pop("singular")
    assert middle == pytest.approx(np.abs(middle[0, 0]) * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
    assert not any(part.any() for part in found.values())


def test_corners_are_each_chosen_once_and_thinned_evenly():
    pairs, four = corner_choices(20, 10_000)
    assert len(pairs) == 10 * 9 // 2
    assert len({frozenset(row) for row in four.tolist()}) == len(pairs)
    thin, _ = corner_choices(200, 2000)
    assert len(thin) <= 2000
    assert thin[:, 1].max() == 50


def test_corner_values_turn_mirror_and_renumber_with_the_domain(nodes, corner):
    size = len(nodes)
    _, four = corner_choices(size, 500)
    plain = valued(corner, nodes, four)
    assert plain.std() > 0
    assert valued(corner, np.roll(nodes, 7, axis=0), (four + 7) % size) == pytest.approx(plain, abs=1e-5)
    assert valued(corner, nodes @ TURN + 3, four) == pytest.approx(plain, abs=1e-5)
    assert valued(corner, nodes, np.roll(four, 1, axis=1)) == pytest.approx(plain, abs=1e-5)
    mirror = (nodes * MIRROR)[::-1].copy()
    assert valued(corner, mirror, (size - 1 - four)[:, [1, 0, 3, 2]]) == pytest.approx(plain, abs=1e-5)


def test_without_pytorch_the_networks_answer_the_same(nodes, corner, placer):
    weights = weights_of({"corner": corner, "placer": placer})
    _, four = corner_choices(len(nodes), 500)
    assert CornerValues(weights)(views(nodes[None])[0], four) == pytest.approx(valued(corner, nodes, four), abs=1e-5)
    seen = np.random.default_rng(0).normal(0, 1, (5, 132))
    there = placer(torch.as_tensor(seen)).detach().numpy()
    assert Placements(weights, "placer", of_square(SHAPED))(seen) == pytest.approx(there, abs=1e-5)
