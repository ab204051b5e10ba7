"""A chain of two states whose values are known: the learner has to find them, not something like them."""

import numpy as np
import pytest
import torch

pytest.importorskip("gymnasium")

from drl_meshgen.rl.value.dqn import DQN, DQNOptions
from drl_meshgen.rl.value.networks import ActionNetwork
from drl_meshgen.rl.value.ppo import PPO, PPOOptions
from drl_meshgen.rl.value.replay import Moment, transitions

STAY, GO, NEVER = 0, 1, 2
DISCOUNT = 0.9
#: In the first state GO leads to the second, STAY ends with 0.5; there GO ends with 1 and STAY with 0.2.
REWARD = {(0, STAY): 0.5, (0, GO): 0.0, (1, STAY): 0.2, (1, GO): 1.0}
VALUES = np.array([[0.5, DISCOUNT * 1.0], [0.2, 1.0]])


class Chain:
    actions = 3
    domains = (0,)

    def __init__(self, count):
        self.count = count
        self.at = np.full(count, 2)
        self.taken = []

    @property
    def over(self):
        return self.at == 2

    def begin(self, which, _domains):
        self.at[which] = 0

    def state(self):
        return {"at": self.at.copy()}

    def observation(self, state):
        return {"at": np.eye(3, dtype=np.float32)[state["at"]]}

    def masks(self):
        return np.tile([True, True, False], (self.count, 1))

    def step(self, actions):
        self.taken.extend(actions.tolist())
        gained = np.array([REWARD[pair] for pair in zip(self.at.tolist(), actions.tolist(), strict=True)])
        self.at = np.where((self.at == 0) & (actions == GO), 1, 2)
        return gained, self.over


class Passage(Chain):
    """Both actions lead on: every episode has two steps, the best takes STAY and then GO."""

    def step(self, actions):
        self.taken.extend(actions.tolist())
        gained = np.array([REWARD[pair] for pair in zip(self.at.tolist(), actions.tolist(), strict=True)])
        self.at += 1
        return gained, self.over


class Table(ActionNetwork):
    def __init__(self):
        super().__init__()
        self.values = torch.nn.Parameter(torch.zeros(3, 3))
        self.worth = torch.nn.Parameter(torch.zeros(3))

    def forward(self, seen, width):
        return (seen["at"] @ self.values)[:, :width]

    def both(self, seen, width):
        return self(seen, width), seen["at"] @ self.worth


def learned(seed=0, steps=2400, **options):
    settled = {"learning_rate": 0.02, "weight_decay": 0.0, "discount": DISCOUNT, "warmup": 64, "sync": 40} | options
    learner = DQN(Table(), Table(), DQNOptions(**settled), np.random.default_rng(seed), 3)
    chain = Chain(4)
    learner.train(chain, lambda: learner.steps >= steps)
    return learner, chain


@pytest.mark.parametrize(
    "options",
    [{}, {"double": False}, {"alpha": 0.6}, {"horizon": 1, "batch": 16}],
    ids=["the paper's", "single", "by priority", "small batches"],
)
def test_values_of_a_chain_of_two_states_are_found_exactly(options):
    learner, _ = learned(**options)
    assert learner.online.values[:2, :2].detach().numpy() == pytest.approx(VALUES, abs=1e-3)


@pytest.mark.parametrize(
    ("horizon", "gains", "discounts"),
    [(1, [1, 2, 4], [0.5, 0.5, 0]), (2, [2, 4, 4], [0.25, 0, 0]), (9, [3, 4, 4], [0, 0, 0])],
)
def test_a_transition_gains_what_its_next_steps_give_and_never_looks_beyond_the_end(horizon, gains, discounts):
    mask = np.array([True, False, True])
    episode = [Moment({"at": np.int64(i)}, mask, i, 2.0**i) for i in range(3)]
    rows = transitions(episode, horizon, 0.5)
    assert [row["gain"] for row in rows] == pytest.approx(gains)
    assert [row["discount"] for row in rows] == pytest.approx(discounts)
    assert [bool(row["mask"].any()) for row in rows] == [d > 0 for d in discounts]


def test_actions_that_the_mask_forbids_are_never_taken_even_where_their_value_is_highest():
    learner = DQN(Table(), Table(), DQNOptions(epsilon=(0.5, 0.5)), np.random.default_rng(0), 3)
    with torch.no_grad():
        learner.online.values[:, NEVER] = 1e6
        learner.target.values[:, NEVER] = 1e6
    chain = Chain(4)
    learner.train(chain, lambda: learner.steps >= 2000)
    assert set(chain.taken) == {STAY, GO}
    assert learner.online.values[:2, :2].detach().abs().max() < 1.5  # nor do they enter any target


def test_same_seed_same_weights_and_another_seed_others():
    weights = [learned(seed, 400)[0].online.values.detach().numpy() for seed in (1, 1, 2)]
    assert np.array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2])


def test_a_learner_that_was_interrupted_ends_with_the_same_weights():
    whole, _ = learned(3, 800, alpha=0.6)
    first, _ = learned(3, 400, alpha=0.6)
    kept = first.snapshot()
    later = DQN(Table(), Table(), first.options, np.random.default_rng(0), 3)
    later.rng.bit_generator.state = first.rng.bit_generator.state
    later.restore(kept)
    later.train(Chain(4), lambda: later.steps >= 800)
    assert np.array_equal(whole.online.values.detach(), later.online.values.detach())


def test_epsilon_falls_by_a_thousandth_per_episode_to_a_twentieth():
    learner = DQN(Table(), Table(), DQNOptions(), np.random.default_rng(0), 3)
    found = []
    for episodes in (0, 1, 1000, 10_000):
        learner.episodes = episodes
        found.append(learner.epsilon)
    assert found == pytest.approx([1.0, 0.999, 0.999**1000, 0.05])


def test_the_policy_gradient_finds_the_best_way_and_what_it_is_worth():
    options = PPOOptions(episodes=32, learning_rate=0.05, batch=64, entropy=0.0)
    learner = PPO(Table(), options, np.random.default_rng(0))
    learner.train(passage := Passage(32), lambda: learner.steps >= 8000)
    chance = learner.network.values[:2].detach().softmax(dim=1).numpy()
    assert chance[0, STAY] > 0.95
    assert chance[1, GO] > 0.95
    assert learner.network.worth[:2].detach().numpy() == pytest.approx([1.5, 1.0], abs=0.1)
    assert set(passage.taken) == {STAY, GO}
