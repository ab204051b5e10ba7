from dataclasses import fields

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, Difficulty, drawn_domain, samples_of
from drl_meshgen.rl.agent import AgentOptions, AgentPolicy, Proposals
from drl_meshgen.rl.controls import PLAIN, SHAPED
from drl_meshgen.rl.kernel import Judged
from drl_meshgen.rl.learning import Bank, Learner, LearnOptions
from drl_meshgen.rl.networks import CornerValue, Placer, weights_of
from drl_meshgen.rl.policies import SHIPPED, policy_named
from drl_meshgen.rl.policy_file import read_card, read_policy, write_policy
from drl_meshgen.rl.symmetry import of_square
from drl_meshgen.templates import Domain, instantiate
from drl_meshgen.templates.score import reward

TURN = np.array([[0.6, 0.8], [-0.8, 0.6]])
ALL = 10_000
TINY = LearnOptions(steps=40, polish=0, domains=4, sizes=(40, 24), width=16, drawn=20)


def drawn(data, count):
    return [sample.domain for sample in samples_of(data, range(count))]


def networks(width):
    torch.manual_seed(0)
    return weights_of({"corner": CornerValue(32), "placer": Placer(of_square(SHAPED), width)})


@pytest.fixture(scope="module")
def bank():
    return Bank(drawn(DataSet.TRAIN, 4), drawn(DataSet.TRAIN_HARD, 4))


@pytest.fixture(scope="module")
def policy():
    return AgentPolicy(networks(16), AgentOptions(tried_first=ALL, tried=ALL))


def trained(bank, steps, options=TINY):
    learner = Learner(bank, options)
    for _ in range(steps):
        learner.advance()
    return learner


def test_the_same_seed_gives_the_same_weights(bank):
    one, two = (trained(bank, 3) for _ in range(2))
    for a, b in zip(weights_of(one.networks).values(), weights_of(two.networks).values(), strict=True):
        assert np.array_equal(a, b)
    other = trained(bank, 3, LearnOptions(**{**TINY.__dict__, "seed": 2}))
    assert not torch.equal(other.placer.body[0].weight, one.placer.body[0].weight)


def test_training_improves_placements_and_corner_values(bank):
    def worth(learner):
        policy, nodes = learner.policy(), bank.kinds[0][0]
        found = policy.proposals(nodes, policy.corners([nodes], ALL)[0][::7], (3,)).judged
        return (found.reward - found.penalty).clip(0)

    before, after = worth(trained(bank, 0)), worth(trained(bank, 40))
    assert after.mean() > before.mean()
    assert after[:20].mean() > before[:20].mean()


def test_a_valid_proposal_comes_before_a_better_one_that_is_not():
    def best(reward, penalty, least):
        given = [np.array(part) for part in (reward, penalty, least)]
        judged = Judged(*given, np.zeros(len(reward)), np.zeros(len(reward)))
        return Proposals(np.zeros((len(reward), 2), np.int64), np.zeros(len(reward), np.int64), {}, judged).judged.best

    assert best([0.9, 0.5, 0.6], [0.1, 0.0, 0.0], [-0.1, 0.2, 0.1]) == 2
    assert best([0.9, 0.8], [0.5, 0.1], [-0.1, -0.2]) == 1


@pytest.mark.parametrize("index", [0, 3])
def test_what_it_chooses_is_a_valid_mesh_worth_what_was_judged(policy, index):
    domain = drawn(DataSet.TEST_STANDARD, index + 1)[index]
    moved = Domain(2.5 * domain.nodes + 4)
    mesh = instantiate(moved, policy.choose(moved))
    found = policy.proposals(domain.nodes, policy.corners([domain.nodes], ALL)[0], (3,))
    assert mesh.valid
    assert float(reward(np.array(mesh.points), np.array(mesh.quads))) == pytest.approx(
        found.judged.reward[found.judged.best], abs=1e-6
    )


def wild_policy():
    """Return one that proposes nothing but folded meshes for most domains."""
    torch.manual_seed(0)
    placer = Placer(of_square(PLAIN), 8)
    torch.nn.init.constant_(placer.body[-1].bias, 3.0)
    torch.nn.init.normal_(placer.body[-1].weight, 0, 3.0)
    return AgentPolicy(
        weights_of({"corner": CornerValue(8), "placer": placer}),
        AgentOptions(tried=2, tried_again=2, layers_again=(3,)),
    )


def test_where_nothing_it_proposes_is_valid_gradient_ascent_helps():
    domain, wild = drawn(DataSet.TEST_STANDARD, 2)[1], wild_policy()
    nodes = domain.nodes
    assert not wild.proposals(nodes, wild.corners([nodes], 2)[0], (3,)).judged.valid.any()
    (chosen,) = wild.choose_all([domain])
    assert instantiate(domain, chosen).valid
    assert same(chosen, wild.choose(domain))


def same(a, b):
    """Whether two sets of parameters are the same bits."""
    return all(np.array_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))


def test_a_batch_of_any_sizes_gets_what_each_gets_alone():
    rng = np.random.default_rng(7)
    sizes = [24, 250, *2 * rng.integers(30, 70, 70)]
    domains = [drawn_domain(list(Difficulty)[i % 2], rng, int(size))[0] for i, size in enumerate(sizes)]
    shipped = policy_named("agent")
    chosen = shipped.choose_all(domains)
    assert len(chosen) == len(domains)
    for domain, one in zip(domains, chosen, strict=True):
        assert same(one, shipped.choose(domain))
    assert same(shipped.choose_all(domains[:3], layers=5)[1], shipped.choose(domains[1], layers=5))


@pytest.mark.parametrize("again", [8, 1])
def test_domains_that_need_other_rounds_or_gradient_ascent_keep_their_places_in_a_batch(again):
    few = read_policy(SHIPPED, AgentOptions(tried_first=1, tried=1, tried_again=again, layers_again=(3,)))
    domains = drawn(DataSet.TEST_HARD, 40)
    first = few.corners([domain.nodes for domain in domains], 1)
    valid = [few.proposals(d.nodes, pairs, (3,)).judged.valid.any() for d, pairs in zip(domains, first, strict=True)]
    assert 0 < sum(valid) < len(valid)
    folded = valid.index(False)
    batch = [domains[valid.index(True)], domains[folded], domains[folded - 1]]
    for domain, one in zip(batch, few.choose_all(batch), strict=True):
        assert same(one, few.choose(domain))
        assert instantiate(domain, one).valid


def test_an_empty_batch_is_empty_and_an_odd_boundary_refused(policy):
    assert policy.choose_all([]) == []
    domain = drawn(DataSet.TEST_STANDARD, 1)[0]
    with pytest.raises(InputError, match="odd number"):
        policy.choose_all([domain, Domain(domain.nodes[1:])])


def test_given_corners_and_layers_are_kept_and_odd_boundaries_refused(policy):
    domain = drawn(DataSet.TEST_STANDARD, 1)[0]
    found = policy.choose(domain, layers=5, corners=(7, 25))
    assert (found.i0, found.m, found.layers) == (7, 25, 5)
    with pytest.raises(InputError, match="odd number"):
        policy.choose(Domain(domain.nodes[1:]))


def test_a_file_gives_back_the_policy_and_always_has_the_same_bytes(policy, tmp_path):
    card = {"seed": 1, "steps": 2, "about": "a test"}
    for name in ("one", "two"):
        write_policy(tmp_path / f"{name}.safetensors", networks(16), card)
    again = read_policy(tmp_path / "one.safetensors", policy.options)
    domain = drawn(DataSet.TEST_STANDARD, 1)[0]
    assert np.array_equal(again.choose(domain).singular, policy.choose(domain).singular)
    assert read_card(tmp_path / "one.safetensors").items() >= card.items()
    assert (tmp_path / "one.safetensors").read_bytes() == (tmp_path / "two.safetensors").read_bytes()


def test_files_that_are_no_policies_are_refused_by_name(tmp_path):
    path = tmp_path / "agent.safetensors"
    with pytest.raises(InputError, match=r"agent.safetensors: no such file"):
        read_policy(path)
    write_policy(path, networks(16), {})
    whole = path.read_bytes()
    for cut in (0, 5, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"agent.safetensors is not a whole safetensors file"):
            read_policy(path)
    path.write_bytes(whole.replace(b'\\"version\\": 1', b'\\"version\\": 7'))
    with pytest.raises(InputError, match="version 7, this program reads version 1"):
        read_policy(path)
    write_policy(path, networks(16) | {"placer.body.2.weight": np.zeros((16, 15), np.float32)}, {})
    with pytest.raises(InputError, match=r"weight placer.body.2.weight has shape \(16, 15\), not \(16, 16\)"):
        read_policy(path)
    write_policy(path, {key: value for key, value in networks(16).items() if key != "corner.node.0.bias"}, {})
    with pytest.raises(InputError, match=r"agent.safetensors: weight corner.node"):
        read_policy(path)
    path.write_bytes(b"\x80\x04pickled" + b"\0" * 100)
    with pytest.raises(InputError, match="is not a whole safetensors file"):
        read_policy(path)
    save_file({"a": torch.zeros(2)}, path)
    assert set(load_file(path)) == {"a"}
    with pytest.raises(InputError, match="is a safetensors file but no policy"):
        read_policy(path)
