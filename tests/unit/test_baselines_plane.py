import numpy as np
import pytest

from drl_meshgen.baselines.plane import PlaneMethod, plane_rivals
from drl_meshgen.baselines.runner import RivalOutcome
from drl_meshgen.mesh import QuadMesh
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.templates import RulePolicy

DOMAIN = next(samples_of(DataSet.TEST_STANDARD, [1])).domain
CORNERS = RulePolicy().choose(DOMAIN).corners


@pytest.fixture(scope="module")
def rivals():
    return plane_rivals(DOMAIN.nodes, CORNERS)


@pytest.mark.parametrize("method", PlaneMethod)
def test_gmsh_makes_only_quads_and_keeps_the_boundary_nodes(rivals, method):
    made = rivals[method]
    assert (made.outcome, made.triangles) == (RivalOutcome.MESHED, 0)
    mesh = QuadMesh(np.column_stack([made.points, 0 * made.points[:, 0]]), made.quads)
    assert mesh.topology.on_boundary.sum() == len(DOMAIN)
    found = plane_metrics(DOMAIN, made.points, made.quads)
    assert found["boundary_fit"] > 0.99
    assert found["validity"] > 0.9


def test_a_method_that_runs_out_of_time_says_so():
    made = plane_rivals(DOMAIN.nodes, CORNERS, [PlaneMethod.BLOSSOM], timeout=0.01)[PlaneMethod.BLOSSOM]
    assert made.outcome is RivalOutcome.TIMED_OUT
    assert len(made.quads) == 0


def test_a_method_that_fails_is_an_outcome():
    made = plane_rivals(np.zeros((20, 2)), np.arange(4), [PlaneMethod.BLOSSOM])[PlaneMethod.BLOSSOM]
    assert made.outcome in {RivalOutcome.CRASHED, RivalOutcome.EMPTY}
    assert len(made.quads) == 0
