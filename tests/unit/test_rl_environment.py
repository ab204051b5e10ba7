import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from drl_meshgen.errors import InputError  # noqa: E402
from drl_meshgen.rl import DataSet, samples_of  # noqa: E402
from drl_meshgen.rl.environment import STEPS, EnvironmentOptions, OTypeEnvironment, inside, position_grid  # noqa: E402
from drl_meshgen.templates import Domain  # noqa: E402
from drl_meshgen.templates.score import reward  # noqa: E402


@pytest.fixture(scope="module")
def domains():
    return [one.domain for one in samples_of(DataSet.TEST_STANDARD, range(3))]


def played(environment, rng, **options):
    """An episode of random actions that count; the last reward and info."""
    _, info = environment.reset(**options)
    for _ in range(STEPS):
        action = rng.choice(np.nonzero(info["action_mask"])[0])
        observation, gained, done, _, info = environment.step(action)
        assert environment.observation_space.contains(observation)
    assert done
    return gained, info


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_it_keeps_the_contract_of_gymnasium(domains):
    check_env(OTypeEnvironment(domains), skip_render_check=True)


def test_only_the_last_of_fourteen_decisions_is_rewarded(domains):
    environment = OTypeEnvironment(domains)
    _, info = environment.reset(seed=1)
    gains = []
    for _ in range(STEPS):
        _, gained, done, _, info = environment.step(np.nonzero(info["action_mask"])[0][0])
        gains.append((gained, done))
    assert gains[:-1] == [(0.0, False)] * 13
    assert gains[-1][1]


def test_the_reward_is_that_of_the_mesh_it_makes(domains):
    environment = OTypeEnvironment(domains, EnvironmentOptions(penalised=False))
    for seed in range(5):
        gained, info = played(environment, np.random.default_rng(seed), seed=seed)
        mesh = environment.mesh()
        assert gained == info["reward"] == pytest.approx(float(reward(np.array(mesh.points), np.array(mesh.quads))))
        assert info["valid"] == mesh.valid
        assert np.array_equal(mesh.points[: len(environment.domain)], environment.domain.nodes)


def test_same_seed_same_episode(domains):
    environment = OTypeEnvironment(domains)
    first = [played(environment, np.random.default_rng(7), seed=3)[0] for _ in range(2)]
    assert first[0] == first[1]


def test_an_action_that_does_not_count_ends_the_episode(domains):
    environment = OTypeEnvironment(domains)
    _, info = environment.reset(seed=0)
    forbidden = np.nonzero(~info["action_mask"])[0]
    _, gained, done, _, _ = environment.step(forbidden[0])
    assert (gained, done) == (-1.0, True)


def test_every_pair_of_corners_can_be_chosen_once(domains):
    environment = OTypeEnvironment(domains)
    seen = set()
    _, info = environment.reset(options={"index": 0})
    for action in np.nonzero(info["action_mask"])[0]:
        environment.reset(options={"index": 0})
        environment._actions.append(int(action))  # the grid of positions is not needed here
        i0, m = environment._corners
        length = len(environment.domain)
        seen.add(frozenset((np.array([i0, i0 + m, i0 + length // 2, i0 + length // 2 + m]) % length).tolist()))
    half = len(environment.domain) // 2
    assert len(seen) == half * (half - 1) / 2  # corners and the same corners begun a side later


def test_the_same_corner_grid_is_found_whatever_the_node_numbers(domains):
    nodes = domains[0].nodes
    turned = Domain(np.roll(nodes, -10, axis=0))
    assert position_grid(turned.nodes, (5, 20), 8) == pytest.approx(position_grid(domains[0].nodes, (15, 20), 8))


def test_positions_of_a_square_are_the_middles_of_its_cells():
    side = np.linspace(0, 1, 5)[:-1]
    zero = np.zeros(4)
    sides = [np.c_[side, zero], np.c_[zero + 1, side], np.c_[1 - side, zero + 1], np.c_[zero, 1 - side]]
    square = np.concatenate(sides)
    grid = position_grid(Domain(square).nodes, (0, 4), 2)
    assert grid[:, :, 0] == pytest.approx(np.array([[0.25, 0.25], [0.75, 0.75]]))
    assert grid[:, :, 1] == pytest.approx(np.array([[0.25, 0.75], [0.25, 0.75]]))


def test_points_of_a_dart_are_told_inside_from_outside():
    dart = np.array([[0.0, 0], [2, 0], [0.4, 0.4], [0, 2]])
    points = np.array([[0.1, 0.1], [1.0, 1.0], [1.5, 0.1], [-0.1, 0.5]])
    assert inside(dart, points).tolist() == [True, False, True, False]


def test_domains_that_do_not_fit_are_refused(domains):
    with pytest.raises(InputError, match="at most 60"):
        OTypeEnvironment(domains, EnvironmentOptions(most_nodes=60))
    with pytest.raises(InputError, match="no domain"):
        OTypeEnvironment([])
