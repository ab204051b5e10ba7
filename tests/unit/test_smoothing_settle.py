"""Nodes go to bumps that quads would bridge, and only where shape allows it."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.pipeline import MeshOptions, mesh_surface
from drl_meshgen.smoothing import SmoothingOptions
from drl_meshgen.smoothing.settle import distances, samples_of
from tests.strategies import flat_disk


@pytest.fixture(scope="module")
def bumpy():
    """A disk with bumps narrower than the quads that are wanted on it."""
    disk = flat_disk(6000)
    x, y = disk.vertices[:, :2].T
    z = sum(0.05 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 0.04**2) for a, b in ((0.21, 0.37), (-0.33, -0.12)))
    return TriMesh(np.c_[x, y, z], disk.triangles)


def meshed(surface, **options):
    given = replace(MeshOptions().sized(target_edge=0.12), smoothing=SmoothingOptions(**options))
    return mesh_surface(surface, given).mesh


def test_nodes_go_to_bumps_that_quads_would_bridge(bumpy):
    plain, settled = meshed(bumpy), meshed(bumpy, settle_rounds=4)
    far = [distances(mesh, mesh.points, samples_of(bumpy))[0].max() for mesh in (plain, settled)]
    assert far[1] < 0.8 * far[0]


def test_nothing_moves_where_the_mesh_is_near_the_surface(bumpy):
    plain, settled = meshed(bumpy), meshed(bumpy, settle_rounds=4, deviation=10.0)
    assert plain.points.tobytes() == settled.points.tobytes()
