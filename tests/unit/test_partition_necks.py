"""Bodies that are joined by a narrow bridge are parted there, wherever the isocontour between their loops runs."""

import numpy as np
import pytest

from drl_meshgen.decompose.cells import submesh
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.cutgraph import trace
from drl_meshgen.partition import CutSurface
from drl_meshgen.partition.necks import at_neck
from tests.chains import tube

WAIST = 1.5


def dumbbell(holes: int) -> TriMesh:
    """Two tubes of radius 4 joined by a short one of radius 1.5, with `holes` holes on either side besides the ends."""
    height = np.r_[np.arange(0, 12), np.linspace(12, 13, 5), np.arange(14, 26)]
    bump = np.exp(-(((height - 12.5) / 0.6) ** 4))
    surface = tube(24, len(height) - 1, 4 - (4 - WAIST) * bump, height)
    gone = np.zeros(len(surface.vertices), bool)
    gone[[24 * row for row in (6, len(height) - 7)][: 2 * holes]] = True
    return submesh(surface, np.nonzero(~gone[surface.triangles].any(axis=1))[0])[0]


def parted(surface: TriMesh, longest: float) -> CutSurface | None:
    """Give the neck between the loops below and above a level through the lower body."""
    whole = CutSurface.whole(surface, np.zeros(len(surface.vertices)))
    return at_neck(whole, surface.vertices[:, 2] > 9.3, longest, 3)


def test_the_curve_between_two_bodies_is_at_their_bridge():
    surface = dumbbell(1)
    cut = parted(surface, 8 * np.pi)
    assert cut is not None
    edges = cut.mesh.topology.edges
    (curve,) = trace(edges[(cut.contour[edges] == 3).all(axis=1)])
    assert closed_length(cut.mesh.vertices[curve]) == pytest.approx(2 * np.pi * WAIST, rel=0.1)
    assert np.abs(cut.mesh.vertices[curve, 2] - 12.5).max() < 0.7
    assert cut.mesh.areas.sum() == pytest.approx(surface.areas.sum(), rel=1e-9)


def test_nothing_is_cut_where_no_curve_is_short_enough():
    assert parted(dumbbell(1), WAIST) is None


def test_a_single_loop_on_a_side_has_no_neck():
    assert parted(dumbbell(0), 8 * np.pi) is None
