from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci import Outcome, RicciOptions, lay_out, solve

MODELS = Path(__file__).parents[2] / ".." / "shared" / "models" / "single"
pytestmark = [pytest.mark.models, pytest.mark.skipif(not MODELS.is_dir(), reason="the model folder is absent")]


def read(name: str) -> TriMesh:
    import pyvista as pv

    mesh = pv.read(MODELS / f"{name}.ply")
    return TriMesh(mesh.points, mesh.faces.reshape(-1, 4)[:, 1:])


@pytest.mark.parametrize("name", ["wingnut", "hand_webxr", "koala"])
@pytest.mark.parametrize("boundary", ["free", "disk"])
def test_real_surfaces_become_flat_in_a_few_steps(name, boundary):
    result = solve(read(name), RicciOptions(boundary=boundary))
    assert result.outcome is Outcome.CONVERGED
    assert len(result.history) <= 8


def test_a_giraffe_that_no_plane_can_hold_has_charts_of_its_regions():
    surface = read("giraffe_dust3d")
    result = solve(surface)
    assert np.ptp(result.u) > 36  # exp(-36) is beyond double precision
    assert lay_out(result.triangulation).closing_error > 0.1
    u = result.u[result.triangulation.faces]
    band = np.nonzero((u.min(axis=1) > -20) & (u.max(axis=1) < -10))[0]
    inside = np.full(len(u), -1)
    inside[band] = np.arange(len(band))
    across = np.where(result.triangulation.glue >= 0, inside[result.triangulation.glue // 3], -1).reshape(-1, 3)[band]
    face, side = np.nonzero(across >= 0)
    graph = coo_matrix((np.ones(len(face)), (face, across[face, side])), (len(band),) * 2)
    count, label = connected_components(graph, directed=False)
    for region in np.argsort(np.bincount(label))[::-1][: min(count, 4)]:
        chart = lay_out(result.triangulation, band[label == region], u_ref=-15.0)
        assert chart.closing_error < 1e-6
        assert not chart.inverted.any()
