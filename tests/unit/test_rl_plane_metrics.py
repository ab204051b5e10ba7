import numpy as np
import pytest

from drl_meshgen.quality import measure
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.templates import Domain, RulePolicy, instantiate
from drl_meshgen.templates.mesh import grid_quads

TURN = np.array([[0.6, 0.8], [-0.8, 0.6]])


def square_grid(n):
    """A square of side n with unit cells; nodes of its boundary, points, quads."""
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    points = np.stack(np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
    rim = np.concatenate([grid[:-1, 0], grid[-1, :-1], grid[:0:-1, -1], grid[0, :0:-1]])
    return Domain(points[rim]), points, grid_quads((grid,))


def test_a_square_of_squares_is_perfect():
    found = plane_metrics(*square_grid(4))
    names = ("orthogonality", "orthogonality_printed", "compliance", "jacobian_ratio", "smoothness", "edge_ratio")
    names += ("validity", "valid", "boundary_fit")
    assert [found[name] for name in names] == pytest.approx([1] * len(names))
    assert (found["quads"], found["boundary_error"]) == (16, 0)
    assert found["reward"] == pytest.approx(0.8)


def test_figures_are_those_of_the_quality_package_and_do_not_change_when_the_mesh_is_moved():
    domain = next(samples_of(DataSet.TEST_STANDARD, [0])).domain
    mesh = instantiate(domain, RulePolicy().choose(domain))
    points, quads = np.array(mesh.points), np.array(mesh.quads)
    found = plane_metrics(domain, points, quads)
    theirs = measure(mesh.blocks.mesh).metrics
    for name in set(found) & set(theirs):
        assert found[name] == pytest.approx(theirs[name]), name
    moved = plane_metrics(Domain(3 * domain.nodes @ TURN + 5), 3 * points @ TURN + 5, quads)
    assert moved == pytest.approx(found)


def test_a_clockwise_quad_is_not_valid():
    domain, points, quads = square_grid(4)
    points = points.copy()
    points[12] = points[18] + 0.5
    found = plane_metrics(domain, points, quads)
    assert found["validity"] < 1
    assert found["valid"] == 0


def test_the_fit_falls_with_the_distance_of_the_boundary_nodes_in_spacings():
    domain, points, quads = square_grid(4)
    far = plane_metrics(domain, points * 0.9 + 0.2, quads)
    near = plane_metrics(domain, points * 0.99 + 0.02, quads)
    assert 0 < near["boundary_error"] < far["boundary_error"]
    assert far["boundary_fit"] == pytest.approx(np.exp(-far["boundary_error"]))
    assert far["reward"] == pytest.approx(0.8 - 0.2 * far["boundary_error"])
