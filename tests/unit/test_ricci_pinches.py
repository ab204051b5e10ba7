import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.ricci import separating_triangles
from tests.ricci_shapes import annulus, bumpy_disk, icosahedron, three_sided_tube


@pytest.mark.parametrize("surface", [bumpy_disk(20, 0, 0.5), annulus(12), icosahedron()])
def test_faces_are_not_necks(surface):
    assert separating_triangles(surface).shape == (0, 3)


def test_inner_rings_of_a_three_sided_tube_are_necks_and_its_boundary_loops_are_not():
    np.testing.assert_array_equal(separating_triangles(three_sided_tube(4)), [[3, 4, 5], [6, 7, 8]])


def test_splitting_a_face_at_an_inner_point_makes_its_old_rim_a_neck():
    surface = icosahedron()
    rim = surface.triangles[5]
    point = surface.vertices[rim].mean(axis=0)
    pieces = [[rim[k], rim[(k + 1) % 3], 12] for k in range(3)]
    split = TriMesh(np.r_[surface.vertices, [point]], np.r_[np.delete(surface.triangles, 5, axis=0), pieces])
    np.testing.assert_array_equal(separating_triangles(split), [np.sort(rim)])


def test_necks_follow_a_renumbering_of_vertices():
    surface = three_sided_tube(6)
    new_of_old = np.random.default_rng(0).permutation(18)
    renumbered = TriMesh(surface.vertices[np.argsort(new_of_old)], new_of_old[surface.triangles])
    expected = np.sort(new_of_old[separating_triangles(surface)], axis=1)
    np.testing.assert_array_equal(separating_triangles(renumbered), expected[np.lexsort(expected.T[::-1])])
