import numpy as np
import pytest

from drl_meshgen.mesh import FeatureCurve, QuadMesh, TriMesh
from drl_meshgen.smoothing import optimise_along
from drl_meshgen.smoothing.curves import CurveTrack
from drl_meshgen.smoothing.nodes import Chain, NodeSpace
from drl_meshgen.smoothing.walk import SurfaceWalker


def roof(n, fold, columns=0):
    """Points of a sheet of n by n cells folded along x = 1/2, moved by a shear that takes mesh lines off the fold."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    x = x + columns * x * (1 - x) * (y - 0.5)
    return np.stack([x, y, fold * np.abs(x - 0.5)], axis=-1).reshape(-1, 3)


def cells(n):
    ids = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)


@pytest.fixture(scope="module")
def folded():
    """A roof, its ridge, and a mesh whose lines cross the ridge at an angle."""
    quads = cells(20)
    surface = TriMesh(roof(20, 0.8), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    mesh = QuadMesh(roof(10, 0.8, columns=0.4), cells(10))
    centres = surface.corners.mean(axis=1)
    triangle = np.argmin(((mesh.points[:, None] - centres) ** 2).sum(axis=2), axis=1)
    ridge = FeatureCurve(np.c_[np.full(21, 0.5), np.linspace(0, 1, 21), np.zeros(21)], False, np.empty(0, np.int64))
    return surface, mesh, triangle, ridge


def test_mesh_line_is_laid_on_a_crease(folded):
    surface, mesh, triangle, ridge = folded
    found = optimise_along(surface, mesh, triangle, [ridge])
    assert found.share == 1
    assert found.deviation < 1e-9
    nodes = found.chains[0].nodes
    assert len(nodes) == 11
    assert np.allclose(found.smoothing.points[nodes, 0], 0.5)
    assert np.allclose(found.smoothing.points[nodes[[0, -1]], 1] % 1, 0)


def test_without_curves_all_are_kept(folded):
    surface, mesh, triangle, _ = folded
    found = optimise_along(surface, mesh, triangle, [])
    assert (found.share, found.deviation, found.chains) == (1.0, 0.0, ())


def test_nodes_of_a_chain_slide_and_do_not_leave_or_pass(folded):
    surface, mesh, triangle, ridge = folded
    nodes = np.arange(5 * 11, 6 * 11)
    track = CurveTrack(SurfaceWalker(surface), [ridge])
    s = track.start[-1] + np.linspace(0, track.length[-1], 11)
    pinned = np.isin(np.arange(11), [0, 10])
    space = NodeSpace(surface, mesh, features=[ridge], chains=[Chain(0, nodes, pinned, s)])
    state, rng = space.start(triangle), np.random.default_rng(0)
    for _ in range(5):
        state = space.moved(state, rng.normal(size=(len(mesh.points), 2)))
    assert np.allclose(state.points[nodes, 0], 0.5)
    assert (np.diff(state.points[nodes, 1]) > 0).all()
    assert np.allclose(state.points[nodes[[0, -1]], 1], [0, 1])


def test_curve_is_given_up_where_it_would_spoil_quads(folded):
    surface, mesh, triangle, ridge = folded
    short = FeatureCurve(np.array([[0.31, 0.3, 0.152], [0.34, 0.32, 0.128]]), False, np.empty(0, np.int64))
    found = optimise_along(surface, mesh, triangle, [ridge, short])
    assert [chain.feature for chain in found.chains] == [0]
    assert 0.9 < found.share < 1


def test_corners_of_a_curve_are_found_by_their_turn():
    quads = cells(8)
    surface = TriMesh(roof(8, 0.0), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    s, angle = CurveTrack(SurfaceWalker(surface)).corners(0, 0.1, np.radians(45))
    assert len(s) == 4
    assert np.allclose(np.degrees(angle), 90)
