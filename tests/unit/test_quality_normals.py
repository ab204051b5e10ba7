"""Normals at points that several triangles share.

        /\\        a roof: two slopes meet in the ridge; the nearest point of anything above the ridge lies on it
       /  \\
"""

import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.quality.normals import least_agreeing_normals, pseudo_normals

ROOF = TriMesh(
    np.array([[0, -1, 0], [2, -1, 0], [2, 0, 1], [0, 0, 1], [2, 1, 0], [0, 1, 0]], float),
    np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]]),
)
RIDGE = np.array([[1.0, 0.0, 1.0]])
ON_RIDGE = [f for f in range(4) if {2, 3} <= set(ROOF.triangles[f].tolist())]


@pytest.mark.parametrize("found", ON_RIDGE)
def test_the_pseudo_normal_on_an_edge_does_not_depend_on_the_triangle_found(found):
    assert np.allclose(pseudo_normals(ROOF, np.array([found]), RIDGE)[0], [0, 0, np.sqrt(2)])


@pytest.mark.parametrize("found", ON_RIDGE)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_least_agreeing_normal_on_an_edge_is_that_of_the_other_slope(found, side):
    normal = least_agreeing_normals(ROOF, np.array([found]), RIDGE, np.array([[0.0, side, 0.1]]))[0]
    assert np.allclose(normal, np.array([0, -side, 1]) / np.sqrt(2))


def test_inside_a_triangle_both_are_its_normal():
    inside = ROOF.corners.mean(axis=1)
    found = np.arange(4)
    assert np.allclose(pseudo_normals(ROOF, found, inside), ROOF.normals)
    assert np.allclose(least_agreeing_normals(ROOF, found, inside, -ROOF.normals), ROOF.normals)


def test_at_a_vertex_all_triangles_around_it_count():
    at = ROOF.vertices[[2]]
    found = np.array([next(f for f in range(4) if 2 in ROOF.triangles[f])])
    normals = [least_agreeing_normals(ROOF, found, at, np.array([[0.0, s, 0.0]]))[0][1] for s in (-1.0, 1.0)]
    assert np.allclose(normals, [np.sqrt(0.5), -np.sqrt(0.5)])
