import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import safetensors.torch
import torch

pytest.importorskip("gymnasium")

from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table, write_table
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.environment import STEPS, EnvironmentOptions
from drl_meshgen.rl.judge_value import main as judge
from drl_meshgen.rl.train_value import RECIPES, Choice, main
from drl_meshgen.rl.value.episodes import play
from drl_meshgen.rl.value.networks import Encoder, NetworkOptions, network, tensors
from drl_meshgen.rl.value.policy import ValuePolicy, load_value_policy, save_value_policy
from drl_meshgen.rl.value.ppo import advantages, chances, policy_loss
from drl_meshgen.rl.value.record import converged
from drl_meshgen.rl.vector import VectorEnvironment
from drl_meshgen.templates import Domain, instantiate
from drl_meshgen.templates.score import reward

GRAPH = NetworkOptions(nodes=6, rounds=2, hidden=16)
RELATIVE = NetworkOptions(Encoder.RELATIVE, nodes=6, rounds=2, hidden=16)
DUELING = NetworkOptions(Encoder.RELATIVE, nodes=6, rounds=2, hidden=16, dueling=True)


@pytest.fixture(scope="module")
def domains():
    return [one.domain for one in samples_of(DataSet.TEST_STANDARD, range(4))]


def made(options, seed=0):
    return network(EnvironmentOptions().actions, options, EnvironmentOptions(), seed)


def seen_after(domains, steps, seed=0):
    """Observation of episodes of random actions after some steps."""
    many, rng = VectorEnvironment(domains, len(domains)), np.random.default_rng(seed)
    many.begin(np.ones(len(domains), bool), np.arange(len(domains)))
    for _ in range(steps):
        many.step(np.where(many.masks(), rng.random(many.masks().shape), -1).argmax(axis=1))
    return tensors(many.observation(many.state()))


@pytest.mark.parametrize("options", [GRAPH, RELATIVE, DUELING], ids=["graph", "relative", "dueling"])
@pytest.mark.parametrize("steps", [0, 3, 8])
def test_a_single_value_is_that_among_all_and_fewer_actions_change_nothing(domains, options, steps):
    model, seen = made(options), seen_after(domains, steps)
    actions = torch.tensor([0, 3, 7, 1])
    with torch.no_grad():
        wide, narrow = model(seen, 3540), model(seen, 8)
        assert torch.allclose(model.at(seen, actions), wide[torch.arange(4), actions], atol=1e-5)
        assert torch.allclose(narrow, wide[:, :8], atol=1e-5)


def test_domains_of_a_batch_do_not_see_one_another(domains):
    seen = seen_after(domains, 0)
    for options in (GRAPH, DUELING):
        with torch.no_grad():
            whole = made(options)(seen, 300)
            single = made(options)({key: one[2:3] for key, one in seen.items()}, 300)
        assert torch.allclose(whole[2:3], single, atol=1e-5)


def test_the_graph_network_knows_which_node_is_the_first(domains):
    nodes = domains[0].nodes
    seen = seen_after([domains[0], Domain(np.roll(nodes, -10, axis=0))], 0)
    with torch.no_grad():
        first, second = made(GRAPH)(seen, 100)
    assert not torch.allclose(first, second, atol=1e-3)


@pytest.mark.parametrize("options", [RELATIVE, DUELING], ids=["policy", "dueling"])
def test_the_relative_network_scores_the_same_corners_alike_however_the_domain_is_turned_and_numbered(domains, options):
    nodes, shift = domains[0].nodes, 10
    half = len(nodes) // 2
    c, s = np.cos(1.1), np.sin(1.1)
    turned = Domain(np.roll(nodes, -shift, axis=0) @ np.array([[c, s], [-s, c]]))
    seen = seen_after([domains[0], turned], 0)
    with torch.no_grad():
        first, second = made(options)(seen, half * (half - 1)).reshape(2, half, half - 1).numpy()
    # resampling the ring at other places than the nodes changes the scores a little
    assert np.abs(first - np.roll(second, shift, axis=0)).max() < 0.05 * np.ptp(first)


def test_the_relative_network_scores_positions_alike_however_the_domain_is_turned(domains):
    c, s = np.cos(1.1), np.sin(1.1)
    both = [domains[1], Domain(domains[1].nodes @ np.array([[c, s], [-s, c]]))]
    many = VectorEnvironment(both, 2)
    many.begin(np.ones(2, bool), np.arange(2))
    with torch.no_grad():
        for _ in range(STEPS):
            first, second = made(RELATIVE)(tensors(many.observation(many.state())), 400)
            assert torch.allclose(first, second, atol=1e-3)
            many.step(np.full(2, many.masks().all(axis=0).argmax()))


def test_forbidden_actions_have_no_chance():
    chance = chances(torch.tensor([[9.0, 0.0, 0.0]]), torch.tensor([[False, True, True]])).exp()
    assert chance[0].tolist() == pytest.approx([0.0, 0.5, 0.5])


def test_advantages_with_a_full_trace_are_what_was_gained_beyond_the_value():
    gained, values = np.array([[1.0], [0.0], [2.0]]), np.array([[0.5], [0.2], [0.1]])
    assert advantages(gained, values, 1.0) == pytest.approx(np.array([[3.0], [2.0], [2.0]]) - values)
    assert advantages(gained, values, 0.0)[:, 0] == pytest.approx([1 + 0.2 - 0.5, 0.1 - 0.2, 2 - 0.1])


def test_the_policy_gains_nothing_from_changes_beyond_the_clip():
    chance = torch.zeros(1, requires_grad=True)
    policy_loss(chance, torch.tensor([-0.5]), torch.ones(1), 0.2).backward()
    assert chance.grad is not None
    assert float(chance.grad) == 0.0


def test_convergence_is_growth_by_less_than_a_share_in_so_many_steps():
    steps = [0, 25_000, 50_000, 75_000]
    assert not converged(steps[:2], [0.1, 0.1], (0.01, 50_000))
    assert not converged(steps, [0.1, 0.5, 0.55, 0.56], (0.01, 50_000))
    assert converged(steps, [0.1, 0.5, 0.55, 0.504], (0.01, 50_000))


def test_a_policy_read_back_chooses_the_same_for_one_domain_as_for_many(domains, tmp_path):
    policy = ValuePolicy(made(RELATIVE, 4), EnvironmentOptions())
    save_value_policy(path := tmp_path / "p.safetensors", policy, RELATIVE, {"seed": 4})
    again = load_value_policy(path)
    for domain, chosen in zip(domains, policy.choose_all(domains), strict=True):
        single = again.choose(domain)
        assert (single.i0, single.m, single.layers) == (chosen.i0, chosen.m, chosen.layers)
        assert np.array_equal(single.bulges, chosen.bulges)
        mesh = instantiate(domain, single)
        assert np.array_equal(mesh.points[: len(domain)], domain.nodes)


def test_a_policy_follows_its_domain_in_the_plane(domains):
    policy = ValuePolicy(made(RELATIVE), EnvironmentOptions())
    here, there = domains[2], Domain(3.0 * domains[2].nodes + [5.0, -2.0])
    moved = 3.0 * policy.choose(here).singular + [5.0, -2.0]
    assert policy.choose(there).singular == pytest.approx(moved, abs=1e-6)


def test_files_that_are_no_policy_are_refused_by_name(tmp_path):
    path = tmp_path / "agent.safetensors"
    save_value_policy(path, ValuePolicy(made(GRAPH), EnvironmentOptions()), GRAPH, {})
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"agent\.safetensors: cannot be read"):
        load_value_policy(path)
    safetensors.torch.save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(InputError, match="no value policy of this version"):
        load_value_policy(path)
    save_value_policy(path, ValuePolicy(made(GRAPH), EnvironmentOptions()), RELATIVE, {})
    with pytest.raises(InputError, match="do not fit"):
        load_value_policy(path)
    with pytest.raises(InputError, match="cannot be read"):
        load_value_policy(tmp_path / "none.safetensors")


def test_a_domain_larger_than_the_action_space_is_refused(domains):
    nodes = domains[0].nodes
    fine = np.stack([nodes, (nodes + np.roll(nodes, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    policy = ValuePolicy(made(GRAPH), EnvironmentOptions())
    with pytest.raises(InputError, match="at most 120"):
        policy.choose(Domain(fine))


def run(folder, choice, steps, data, seed=0):
    given = ["--learner", choice.value, "--steps", str(steps), "--every", "500", "--seed", str(seed)]
    main([*given, "--domains", "6", "--data", str(data), "--out", str(folder)])
    return safetensors.torch.load_file(folder / "policy.safetensors")


SMALL = {
    Choice.DQN: {"warmup": 100, "batch": 8, "steps_per_gradient": 16},
    Choice.RAINBOW: {"warmup": 100, "batch": 8, "steps_per_gradient": 16},
    Choice.PPO: {"episodes": 16, "epochs": 1, "batch": 64},
}


@pytest.mark.parametrize("choice", list(Choice))
def test_same_seed_same_weights_also_when_interrupted(choice, monkeypatch, tmp_path_factory, tmp_path, capsys):
    recipe, steps, data = RECIPES[choice], 672, tmp_path_factory.getbasetemp() / "domains"
    small = replace(recipe.network, nodes=6, rounds=1, hidden=16), replace(recipe.learner, **SMALL[choice])
    monkeypatch.setitem(RECIPES, choice, replace(recipe, network=small[0], learner=small[1]))
    whole = run(tmp_path / "whole", choice, 2 * steps, data)
    run(tmp_path / "parts", choice, steps, data)
    parts = run(tmp_path / "parts", choice, 2 * steps, data)
    other = run(tmp_path / "other", choice, steps, data, seed=1)
    assert all(torch.equal(whole[key], parts[key]) for key in whole)
    assert not all(torch.equal(whole[key], other[key]) for key in whole)
    curve = read_table(tmp_path / "whole" / "curve.parquet")
    assert curve["steps"].iloc[-1] == 2 * steps
    assert curve["steps"].is_monotonic_increasing
    assert len(read_table(tmp_path / "whole" / "curve-seconds.parquet")) == len(curve)
    assert list((tmp_path / "whole" / "tensorboard").iterdir())
    assert "policy.safetensors" in capsys.readouterr().out
    checkpoints = [tmp_path / folder / "checkpoint.safetensors" for folder in ("whole", "parts")]
    first, second = map(safetensors.torch.load_file, checkpoints)
    assert first.keys() == second.keys()
    assert all(torch.equal(first[key], second[key]) for key in first)
    checkpoints[1].write_bytes(checkpoints[1].read_bytes()[:-100])
    with pytest.raises(InputError, match=r"checkpoint\.safetensors: is no whole checkpoint"):
        run(tmp_path / "parts", choice, 2 * steps, data)
    other_choice = Choice.DQN if choice is Choice.PPO else Choice.PPO
    with pytest.raises(InputError, match="does not fit this run"):
        run(tmp_path / "other", other_choice, steps, data)


def test_every_recipe_has_a_network_that_plays_whole_episodes(domains):
    for recipe in RECIPES.values():
        many = VectorEnvironment(domains, 4)
        play(made(recipe.network), many, np.arange(4))
        assert many.over.all()
        assert {p.layers for p in map(many.parameters, range(4))} <= set(range(3, 11))


def test_judging_writes_a_row_per_policy_and_domain_and_the_times_apart(tmp_path, capsys):
    for name, options in (("a", GRAPH), ("b", RELATIVE)):
        policy = ValuePolicy(made(options), EnvironmentOptions())
        save_value_policy(tmp_path / f"{name}.safetensors", policy, options, {})
    judge([str(tmp_path / "a.safetensors"), str(tmp_path / "b.safetensors"), "--domains", "2", "--out", str(tmp_path)])
    table = read_table(tmp_path / "scores.parquet")
    assert table[["policy", "set", "index"]].drop_duplicates().shape[0] == len(table) == 8
    assert "ms" not in " ".join(table)
    assert (tmp_path / "scores-ms.csv").read_text().startswith("policy,set,ms_single,ms_together")
    assert "test-hard" in capsys.readouterr().out
    sample = next(samples_of(DataSet.TEST_HARD, [1]))
    mesh = instantiate(sample.domain, policy.choose(sample.domain))
    found = table[(table["policy"] == "b") & (table["set"] == "test-hard")].iloc[1]
    assert found["reward"] == pytest.approx(float(reward(np.array(mesh.points), np.array(mesh.quads))))
    assert found["valid"] == mesh.valid


def test_the_gallery_draws_learning_curves(tmp_path):
    point = {"steps": 1000, "mean_return": 0.1, "valid": 0.5}
    write_table(tmp_path / "curve-ppo.parquet", pd.DataFrame([point, point | {"steps": 2000}]))
    draw = runpy.run_path(str(Path(__file__).parents[2] / "docs/gallery/learning_curves.py"))["main"]
    assert draw([str(tmp_path)]).stat().st_size > 1000
