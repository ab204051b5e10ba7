import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.ascent import Mesh, ascended
from drl_meshgen.rl.controls import SHAPED, parts_of
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.optimum import OptimizerPolicy, tutte_points
from drl_meshgen.templates import Domain, instantiate
from drl_meshgen.templates.score import Weights

QUICK = OptimizerPolicy(tried=4, kept=1, layers=(3,), iterations=(10, 40))


@pytest.fixture(scope="module")
def domain():
    return next(samples_of(DataSet.TEST_HARD, [3])).domain


def test_its_nodes_and_worth_are_those_of_the_template(domain):
    x = np.concatenate(
        [tutte_points(domain.nodes, np.array([[5, 20]]))[0].ravel(), 0.02 * np.cos(np.arange(SHAPED - 8))]
    )
    value, _ = Mesh.of(domain, (5, 20), 4).worth(x, Weights())
    judged = judge_o(domain.nodes, np.array([[5, 20]]), np.array([4]), **parts_of(x[None]))
    assert value == pytest.approx((judged.reward - judged.penalty)[0], abs=1e-12)


def test_its_gradient_is_that_of_differences(domain):
    mesh, rng = Mesh.of(domain, (5, 20), 3), np.random.default_rng(0)
    x = np.concatenate([tutte_points(domain.nodes, np.array([[5, 20]]))[0].ravel(), rng.normal(0, 0.02, SHAPED - 8)])
    slope = mesh.worth(x, Weights())[1]
    step = 1e-6 * np.eye(SHAPED)
    differences = [(mesh.worth(x + e, Weights())[0] - mesh.worth(x - e, Weights())[0]) / 2e-6 for e in step]
    assert slope == pytest.approx(np.array(differences), abs=1e-7)


def test_ascent_ascends(domain):
    mesh = Mesh.of(domain, (5, 20), 3)
    start = np.concatenate([tutte_points(domain.nodes, np.array([[5, 20]]))[0].ravel(), np.zeros(16)])
    worth, x = ascended(mesh, start, 20, Weights())
    assert worth > mesh.worth(start, Weights())[0] + 0.01
    assert worth == pytest.approx(mesh.worth(x, Weights())[0])


def test_its_meshes_are_valid_and_move_with_the_domain(domain):
    found = QUICK.choose(domain)
    assert instantiate(domain, found).valid
    moved = Domain(3 * domain.nodes + 7)
    again = QUICK.choose(moved)
    assert (again.i0, again.m, again.layers) == (found.i0, found.m, found.layers)
    assert again.singular == pytest.approx(3 * found.singular + 7, abs=1e-3)


def test_given_corners_and_layers_are_kept_and_odd_boundaries_refused(domain):
    found = QUICK.choose(domain, layers=5, corners=(7, 25))
    assert (found.i0, found.m, found.layers) == (7, 25, 5)
    with pytest.raises(InputError, match="odd number"):
        QUICK.choose(Domain(domain.nodes[1:]))
