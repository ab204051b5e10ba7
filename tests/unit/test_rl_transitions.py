import numpy as np
import pytest
import torch

from drl_meshgen.errors import InputError
from drl_meshgen.rl.agent import AgentPolicy
from drl_meshgen.rl.ascent import Mesh
from drl_meshgen.rl.c_domains import drawn_counts, four_sided
from drl_meshgen.rl.c_learning import TransitionLearner, TransitionLearnOptions
from drl_meshgen.rl.checkpoint import read_checkpoint, write_checkpoint
from drl_meshgen.rl.kernel import judge_c
from drl_meshgen.rl.networks import weights_of
from drl_meshgen.rl.optimum import OptimizerPolicy
from drl_meshgen.rl.policies import SHIPPED, policy_named
from drl_meshgen.rl.policy_file import read_card, read_policy, read_weights, write_policy
from drl_meshgen.rl.transitions import GRID, counts_at, shares_around
from drl_meshgen.templates import CCounts, CParameters, CSides, Domain, RulePolicy, fill_transition, instantiate_c
from drl_meshgen.templates.score import Weights

SEED = 11
TURN = np.array([[0.6, 0.8], [-0.8, 0.6]])
TINY = TransitionLearnOptions(steps=6, shapes=10, domains=3, choices=2, sizes=(24, 40), width=8)


@pytest.fixture(scope="module")
def agent():
    return policy_named("agent")


def reward_of(one, found):
    judged = judge_c(one.domain.nodes, [found])
    return judged.reward[0] if judged.valid[0] else 0.0


@pytest.mark.parametrize("index", range(3))
def test_the_linear_mesh_is_the_template_and_its_slope_is_exact(index):
    one = next(four_sided(SEED, [index], 32))
    rng = np.random.default_rng(index)
    counts = drawn_counts(rng, one.sides)
    mesh, rule = Mesh.of_transition(one.domain, 0, counts), RulePolicy().transition(one.domain, 0, counts)
    x = np.concatenate([rule.singular.ravel(), rng.normal(0, 0.03, 24)])
    bent = CParameters(0, counts, rule.singular, x[8:].reshape(12, 2))
    value, slope = mesh.worth(x, Weights())
    judged = judge_c(one.domain.nodes, [bent])
    assert value == pytest.approx(judged.reward[0] - judged.penalty[0], abs=1e-9)
    step = 1e-6 * rng.normal(0, 1, len(x))
    change = mesh.worth(x + step, Weights())[0] - mesh.worth(x - step, Weights())[0]
    assert change == pytest.approx(2 * slope @ step, rel=1e-3, abs=1e-10)


@pytest.mark.parametrize("sides", [CSides(5, 2, 3), CSides(14, 11, 4), CSides(80, 97, 68)])
def test_counts_that_are_tried_fit_the_sides_and_differ(sides):
    counts = counts_at(sides, GRID)
    assert {one.sides for one in counts} == {sides}
    assert len(set(counts)) == len(counts)
    assert counts[0] in counts_at(sides, shares_around(counts[0], (0.1, 0.1, 0.1)))


@pytest.mark.parametrize("sides", [CSides(8, 4, 8), CSides(9, 4, 4), CSides(6, 4, 2), CSides(9, 1, 5)])
@pytest.mark.parametrize("policy", ["rule", "agent", "optimizer"])
def test_sides_that_no_transition_fits_are_refused(sides, policy):
    count = sides.bottom + sides.top + 2 * sides.side
    angle = 2 * np.pi * np.arange(count) / count
    with pytest.raises(InputError, match=r"need an even, positive difference|at least 3 and 2 are needed"):
        policy_named(policy).transition(Domain(np.c_[np.cos(angle), np.sin(angle)]), 0, sides)


def test_the_agent_is_valid_on_fresh_domains_and_ahead_of_the_rule(agent):
    domains = list(four_sided(SEED, range(60)))
    rewards = np.array(
        [[reward_of(d, p.transition(d.domain, 0, d.sides)) for p in (agent, RulePolicy())] for d in domains]
    )
    assert (rewards[:, 0] > 0).all()
    assert (rewards[:, 0] - rewards[:, 1]).mean() > 0.03


def test_gradient_ascent_is_ahead_of_the_rule_with_the_same_counts():
    for one in four_sided(SEED, [0, 2, 3], 40):
        counts = CCounts.between(one.sides)
        ascended = OptimizerPolicy().transition(one.domain, 0, counts)
        assert ascended.counts == counts
        assert reward_of(one, ascended) > reward_of(one, RulePolicy().transition(one.domain, 0, counts))


@pytest.mark.parametrize("index", [0, 2, 3, 4])
def test_a_turned_mirrored_and_renumbered_domain_gets_the_same_mesh(agent, index):
    one = next(four_sided(SEED, [index], 60))
    plain = instantiate_c(one.domain, agent.transition(one.domain, 0, one.sides))
    turned = Domain(np.roll(one.domain.nodes @ TURN * 3 + 5, 7, axis=0))
    mirrored = Domain(np.roll((one.domain.nodes * [-1, 1])[::-1], one.sides.bottom + 1, axis=0))
    first = instantiate_c(turned, agent.transition(turned, 7, one.sides)).points
    second = instantiate_c(mirrored, agent.transition(mirrored, 0, one.sides)).points
    for points, image in ((first, plain.points @ TURN * 3 + 5), (second, plain.points * [-1, 1])):
        gaps = np.linalg.norm(points[:, None] - image, axis=2).min(axis=1)
        assert gaps.max() < 1e-4


def test_a_patch_is_filled_by_the_policy_that_is_asked(agent):
    one = next(four_sided(SEED, [0], 60))
    filled = fill_transition(one.domain.nodes, 0, one.sides, agent)
    assert filled.valid
    assert filled.parameters.counts == agent.transition(one.domain, 0, one.sides).counts


def test_a_policy_without_weights_for_transitions_finds_them_by_ascent(tmp_path):
    weights = {key: value for key, value in read_weights(SHIPPED).items() if not key.startswith("c_placer")}
    write_policy(tmp_path / "old.safetensors", weights, {})
    policy = read_policy(tmp_path / "old.safetensors")
    one = next(four_sided(SEED, [0], 32))
    assert isinstance(policy, AgentPolicy)
    assert np.array_equal(
        policy.transition(one.domain, 0, one.sides).singular,
        OptimizerPolicy().transition(one.domain, 0, one.sides).singular,
    )


def test_weights_for_transitions_of_other_shapes_are_refused_by_name(tmp_path):
    weights = read_weights(SHIPPED) | {"c_placer.body.0.weight": np.zeros((3, 3), np.float32)}
    write_policy(tmp_path / "odd.safetensors", weights, {})
    with pytest.raises(InputError, match=r"odd.safetensors: weight c_placer.body.0.weight has shape \(3, 3\)"):
        read_policy(tmp_path / "odd.safetensors")
    assert "transitions" in read_card(SHIPPED)


def test_training_goes_on_from_a_checkpoint_as_if_never_interrupted(tmp_path):
    straight, first, second = (TransitionLearner(TINY) for _ in range(3))
    for _ in range(6):
        straight.advance()
    for _ in range(4):
        first.advance()
    write_checkpoint(tmp_path / "one.safetensors", first)
    read_checkpoint(tmp_path / "one.safetensors", second)
    for _ in range(2):
        second.advance()
    ends = [weights_of(one.networks) for one in (straight, second)]
    assert all(np.array_equal(ends[0][key], ends[1][key]) for key in ends[0])
    (tmp_path / "one.safetensors").write_bytes((tmp_path / "one.safetensors").read_bytes()[:300])
    with pytest.raises(InputError, match="is no whole checkpoint"):
        read_checkpoint(tmp_path / "one.safetensors", second)


def test_training_improves_on_tuttes_embedding():
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        learner = TransitionLearner(TransitionLearnOptions(steps=60, shapes=50, domains=4, sizes=(40,), width=32))
        worth = [learner.advance() for _ in range(60)]
    finally:
        torch.set_num_threads(threads)
    assert np.mean(worth[-10:]) > np.mean(worth[:10]) + 0.02
