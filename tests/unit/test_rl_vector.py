import numpy as np
import pytest

pytest.importorskip("gymnasium")

from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.environment import STEPS, EnvironmentOptions, OTypeEnvironment
from drl_meshgen.rl.vector import VectorEnvironment
from drl_meshgen.templates import Domain, instantiate

ALL = np.ones(4, bool)


@pytest.fixture(scope="module")
def domains():
    drawn = [one.domain for one in samples_of(DataSet.TEST_HARD, range(4))]
    return [*drawn[:3], Domain(2.5 * drawn[3].nodes + [3.0, -1.0])]


def drawn(masks, rng):
    return np.array([rng.choice(np.nonzero(mask)[0]) for mask in masks])


@pytest.mark.parametrize("penalised", [True, False])
def test_episodes_side_by_side_are_those_of_the_single_environment_action_by_action(domains, penalised):
    options = EnvironmentOptions(penalised=penalised)
    many = VectorEnvironment(domains, 4, options)
    single = [OTypeEnvironment(domains, options) for _ in range(4)]
    rng = np.random.default_rng(0)
    for _ in range(3):
        index = rng.permutation(4)
        many.begin(ALL, index)
        seen = [one.reset(options={"index": i})[0] for one, i in zip(single, index, strict=True)]
        for _ in range(STEPS):
            masks, observed = many.masks(), many.observation(many.state())
            assert np.array_equal(masks, [one.action_masks() for one in single])
            for i in range(4):
                for key, value in seen[i].items():
                    assert observed[key][i] == pytest.approx(value, abs=1e-6), key
            actions = drawn(masks, rng)
            gained, done = many.step(actions)
            steps = [one.step(a) for one, a in zip(single, actions, strict=True)]
            seen = [step[0] for step in steps]
            assert gained == pytest.approx([step[1] for step in steps], abs=1e-9)
            assert done.tolist() == [step[2] for step in steps]
        assert many.over.all()
        assert many.valid.tolist() == [step[4]["valid"] for step in steps]
        for i, one in enumerate(single):
            domain = domains[index[i]]
            world = instantiate(domain, many.parameters(i)).points
            assert domain.frame.to_local(world) == pytest.approx(one.mesh().points, abs=1e-9)


def test_episodes_may_be_at_different_steps(domains):
    many = VectorEnvironment(domains, 4)
    rng = np.random.default_rng(1)
    many.begin(ALL, np.arange(4))
    for _ in range(3):
        many.step(drawn(many.masks(), rng))
    many.begin(np.array([True, False, False, False]), np.array([2]))
    assert many.state()["step"].tolist() == [0, 3, 3, 3]
    many.step(drawn(many.masks(), rng))
    assert many.state()["step"].tolist() == [1, 4, 4, 4]


def test_an_action_that_does_not_count_is_an_error_that_names_it(domains):
    many = VectorEnvironment(domains, 4)
    many.begin(ALL, np.arange(4))
    with pytest.raises(InputError, match="action 3539 of episode 0"):
        many.step(np.full(4, 3539))
    with pytest.raises(InputError, match="0 of 14 decisions"):
        many.parameters(0)
