"""Opening surfaces along seams."""

import numpy as np

from drl_meshgen.seams import open_surface
from tests.strategies import flat_disk


def test_a_surface_with_a_boundary_and_no_handle_comes_back_as_it_is():
    disk = flat_disk(300)
    opened = open_surface(disk)
    assert opened.mesh is disk
    np.testing.assert_array_equal(opened.parent, np.arange(len(disk.triangles)))
    assert opened.seams == ()
    assert opened.table.empty
