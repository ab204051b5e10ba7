"""A tube whose ends have different counts: sector by a C-type transition, the rest plain."""

import numpy as np
import pytest

from drl_meshgen.assembly.align import Columns, across_transition, sector
from drl_meshgen.assembly.transition import transition_fill
from drl_meshgen.codecs import SUBDOMAINS
from drl_meshgen.mesh import BlockMesh
from drl_meshgen.quality import measure
from drl_meshgen.templates import RulePolicy
from tests.chains import run_on
from tests.strategies import limbed_disk


def columns(n):
    return Columns(0, 1, np.arange(n) / n)


def filled(n, m, rows=10, modulus=1.0):
    one = columns(max(n, m))
    other = Columns(0, 1, across_transition(one.theta, min(n, m)))
    return transition_fill(*((one, other) if n > m else (other, one)), rows, modulus, RulePolicy())


def welded(fill):
    """The blocks rolled up to a cylinder of unit girth."""
    angle = 2 * np.pi * fill.chart[:, 0]
    points = np.c_[np.cos(angle), np.sin(angle), 2 * np.pi * fill.chart[:, 1]] / (2 * np.pi)
    return BlockMesh(points, fill.grids)


@pytest.mark.parametrize(("n", "m"), [(16, 14), (14, 16), (20, 14), (12, 10)])
def test_a_transition_closes_the_ring_with_four_irregular_nodes(n, m):
    mesh = welded(filled(n, m)).mesh
    t = mesh.topology
    assert t.euler == 0
    assert sorted(len(loop) for loop in t.loops) == sorted((n, m))
    assert not len(t.misoriented_edges)
    assert sorted(t.valence[mesh.irregular].tolist()) == [3, 3, 5, 5]


@pytest.mark.parametrize(("n", "m"), [(16, 12), (12, 16)])
def test_a_transition_has_nine_blocks_beside_the_plain_columns(n, m):
    fill = filled(n, m)
    assert len(fill.grids) == 10
    assert measure(welded(fill).mesh, block=welded(fill).block).defects == ()


def test_columns_outside_the_sector_go_straight_on():
    theta = np.arange(16) / 16
    wide, narrow = sector(2)
    assert np.allclose(across_transition(theta, 12)[narrow:], theta[wide:])
    assert np.allclose(across_transition(across_transition(theta, 12), 16)[wide:], theta[wide:])


def test_equal_counts_need_no_transition():
    theta = np.arange(8) / 8
    assert across_transition(theta, 8) is theta


@pytest.fixture(scope="module")
def tapered():
    surface = limbed_disk(5000, 2, 2.5, seed=1)
    return run_on(surface, 1200, ["quality"], transitions=True, transition_cost=0.0)


def test_a_mesh_with_transitions_is_sound(tapered):
    assert (tapered["subdomain"].templates.template == "C").any()
    assert tapered["quality"].defects == ()


def test_transitions_survive_writing_and_reading(tapered, tmp_path):
    SUBDOMAINS.write(tapered["subdomain"], tmp_path)
    back = SUBDOMAINS.read(tmp_path)
    for one, two in zip(tapered["subdomain"].rings, back.rings, strict=True):
        assert type(one) is type(two)
        assert np.array_equal(one.chart, two.chart)
        assert np.array_equal(one.last, two.last)
