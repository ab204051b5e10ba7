import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.rivals import EvolutionPolicy, GeneticPolicy, Search, SqpPolicy
from drl_meshgen.templates import Domain, instantiate
from drl_meshgen.templates.score import Weights, reward, validity_penalty

DOMAIN = next(samples_of(DataSet.TEST_STANDARD, [1])).domain
QUICK = {
    "sqp": SqpPolicy(starts=2, evaluations=20),
    "ga": GeneticPolicy(population=12, generations=12),
    "cma": EvolutionPolicy(starts=1, evaluations=150),
}
LONGER = {
    "sqp": SqpPolicy(starts=2, evaluations=60),
    "ga": GeneticPolicy(population=12, generations=60),
    "cma": EvolutionPolicy(starts=1, evaluations=600),
}


def worth(domain, parameters):
    mesh = instantiate(domain, parameters)
    points, quads = np.array(mesh.points), np.array(mesh.quads)
    return float(reward(points, quads) - validity_penalty(points, quads))


@pytest.mark.parametrize("name", QUICK)
def test_the_same_domain_and_seed_give_the_same_parameters(name):
    one, two = (QUICK[name].choose(DOMAIN) for _ in range(2))
    assert (one.i0, one.m, one.layers) == (two.i0, two.m, two.layers)
    assert (one.singular == two.singular).all()
    assert (one.bulges == two.bulges).all()


@pytest.mark.parametrize("name", QUICK)
def test_a_larger_budget_finds_no_worse_mesh(name):
    assert worth(DOMAIN, LONGER[name].choose(DOMAIN)) >= worth(DOMAIN, QUICK[name].choose(DOMAIN))


@pytest.mark.parametrize("name", QUICK)
def test_scale_and_place_of_the_domain_do_not_matter(name):
    here = QUICK[name].choose(DOMAIN)
    there = QUICK[name].choose(Domain(4 * DOMAIN.nodes + 4))
    assert there.i0 == here.i0
    assert there.singular == pytest.approx(4 * here.singular + 4, abs=1e-4)


@pytest.mark.parametrize("name", QUICK)
def test_a_given_number_of_layers_is_kept_and_odd_boundaries_are_refused(name):
    assert QUICK[name].choose(DOMAIN, layers=4).layers == 4
    with pytest.raises(InputError, match="odd"):
        QUICK[name].choose(Domain(DOMAIN.nodes[1:]))
    with pytest.raises(InputError, match="chooses the corners itself"):
        QUICK[name].choose(DOMAIN, corners=(0, 10))


def test_points_of_the_space_are_worth_what_their_meshes_are():
    search = Search(Domain(DOMAIN.frame.to_local(DOMAIN.nodes)), (3, 10), Weights())
    rng = np.random.default_rng(0)
    low, high = search.bounds
    integers = rng.integers(low[:3].astype(int), high[:3].astype(int), size=(20, 3), endpoint=True)
    reals = 0.1 * rng.uniform(low[3:], high[3:], (20, 24))
    found = search.worth(integers, reals)
    meshes = [search.parameters(DOMAIN, i, x) for i, x in zip(integers, reals, strict=True)]
    valid = search.judged(integers, reals).valid
    assert valid.any()
    assert found[valid] == pytest.approx([worth(DOMAIN, p) for p, ok in zip(meshes, valid, strict=True) if ok])
    best = search.best_layers(integers[0, :2], reals[0])
    every = [search.worth(np.array([[*integers[0, :2], k]]), reals[:1])[0] for k in range(3, 11)]
    assert best[2] == 3 + int(np.argmax(every))


def test_sqp_spends_its_evaluations_and_no_more(monkeypatch):
    calls = []
    count = judge_o

    def counted(nodes, corners, *more):
        calls.append(len(corners))
        return count(nodes, corners, *more)

    monkeypatch.setattr("drl_meshgen.rl.rivals.judge_o", counted)
    SqpPolicy(starts=2, evaluations=15).choose(DOMAIN)
    assert set(calls) == {25}  # the point and one step in each direction
    assert len(calls) <= 30
