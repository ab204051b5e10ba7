import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.templates import Domain, OParameters, instantiate
from drl_meshgen.templates.curves import LINE_TYPES
from drl_meshgen.templates.o_type import grids


def disk(count):
    angle = 2 * np.pi * np.arange(count) / count
    return Domain(np.c_[np.cos(angle), np.sin(angle)])


def parameters(domain, i0, m, k, **changes):
    n = len(domain) // 2 - m
    corners = (i0 + np.array([0, m, m + n, 2 * m + n])) % len(domain)
    values = {"singular": 0.6 * domain.nodes[corners], "bulges": np.zeros((8, 2)), **changes}
    return OParameters(i0, m, n, k, **values)


@pytest.mark.parametrize(("count", "i0", "m", "k"), [(8, 0, 2, 1), (8, 3, 1, 2), (24, 17, 6, 3), (30, 29, 4, 5)])
def test_structure_of_every_core_size(count, i0, m, k):
    domain = disk(count)
    mesh = instantiate(domain, parameters(domain, i0, m, k))
    n = count // 2 - m
    topology = mesh.blocks.mesh.topology
    assert [g.shape for g in mesh.grids] == [(m + 1, n + 1), *((c + 1, k + 1) for c in (m, n, m, n))]
    assert topology.euler == 1
    assert topology.used.all()
    assert len(topology.misoriented_edges) == 0
    assert len(mesh.points) == count * k + (m + 1) * (n + 1)
    assert sorted(topology.valence[mesh.blocks.mesh.irregular]) == [3, 3, 3, 3]
    assert (topology.valence[:count] == 3).all()


def test_singular_points_lie_where_asked_and_are_the_irregular_nodes():
    domain = disk(20)
    p = parameters(domain, 3, 4, 3)
    mesh = instantiate(domain, p)
    irregular = mesh.points[mesh.blocks.mesh.irregular]
    assert {tuple(x) for x in irregular.tolist()} == {tuple(x) for x in p.singular.tolist()}


def test_every_ring_faces_its_boundary_node():
    blocks = grids(5, 3, 4, 2)
    for outer in blocks[1:]:
        assert np.array_equal(outer % 14, np.repeat(outer[:, :1], 3, axis=1))
        assert np.array_equal(outer // 14, np.broadcast_to([0, 1, 2], outer.shape))


@pytest.mark.parametrize("line_type", range(len(LINE_TYPES)))
def test_line_types_move_interior_nodes_only(line_type):
    domain = disk(24)
    mesh = instantiate(domain, parameters(domain, 0, 6, 3, bulges=np.tile(LINE_TYPES[line_type] / 3, (8, 1))))
    assert np.array_equal(mesh.points[:24], domain.nodes)
    assert mesh.valid


def test_layers_are_graded_along_the_spokes():
    domain = disk(16)
    mesh = instantiate(domain, parameters(domain, 0, 4, 4, grading=0.5))
    spoke = mesh.points[mesh.grids[1][0]]
    steps = np.linalg.norm(np.diff(spoke, axis=0), axis=1)
    assert steps[1:] / steps[:-1] == pytest.approx([0.5] * 3)


def test_a_square_domain_with_proportional_core_is_meshed_by_straight_lines():
    t = np.arange(6) / 6
    square = np.concatenate([np.c_[t, 0 * t], np.c_[1 + 0 * t, t], np.c_[1 - t, 1 + 0 * t], np.c_[0 * t, 1 - t]])
    domain = Domain(square)
    mesh = instantiate(domain, OParameters(0, 6, 6, 2, 0.5 + 0.5 * (square[::6] - 0.5), np.zeros((8, 2))))
    core = mesh.points[mesh.grids[0]]
    lines = np.linspace(0.25, 0.75, 7)
    assert core == pytest.approx(np.stack(np.meshgrid(lines, lines, indexing="ij"), axis=-1))


def test_corners_that_do_not_divide_the_boundary_are_refused():
    with pytest.raises(InputError, match="24 nodes"):
        instantiate(disk(24), parameters(disk(20), 0, 4, 2))


@pytest.mark.parametrize(("m", "k"), [(0, 1), (4, 0), (12, 1)])
def test_counts_must_be_positive(m, k):
    with pytest.raises(InputError, match="positive"):
        parameters(disk(24), 0, m, k)
