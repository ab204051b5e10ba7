"""Whatever the bumps and limbs: regions keep the books, and the mesh is sound."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.partition import PartitionOptions, partition
from tests.chains import run_on
from tests.strategies import bumpy_disks, flat_disk, limbed_disk

SHEET = flat_disk(1200)


@st.composite
def depths(draw):
    """Depth on the flat disk with up to five tips, 0 on the rim."""
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    x, y = SHEET.vertices[:, 0], SHEET.vertices[:, 1]
    depth = np.zeros(len(x))
    for _ in range(draw(st.integers(0, 5))):
        radius, angle = 0.8 * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        width, tall = rng.uniform(0.1, 0.3), rng.uniform(1, 8)
        tip = radius * np.array([np.cos(angle), np.sin(angle)])
        depth += tall * np.exp(-((x - tip[0]) ** 2 + (y - tip[1]) ** 2) / width**2)
    return depth * (1 - x**2 - y**2).clip(0)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(depths())
def test_any_depth_divides_the_surface_into_regions_that_keep_the_books(depth):
    parts = partition(SHEET, -depth, PartitionOptions(smoothing=0))
    assert sum(region.euler for region in parts.regions) == SHEET.topology.euler
    owners = np.bincount([c for region in parts.regions for c in region.loops], minlength=len(parts.curves))
    np.testing.assert_array_equal(owners, [1 if curve.is_boundary else 2 for curve in parts.curves])
    assert all(2 - region.euler == len(region.loops) for region in parts.regions)
    np.testing.assert_allclose(np.bincount(parts.surface.parent, parts.surface.mesh.areas), SHEET.areas, rtol=1e-9)
    assert (parts.isovalues.isovalue > parts.isovalues.arc_low).all()
    assert (parts.isovalues.isovalue < parts.isovalues.arc_high).all()


def check(surface, quads):
    execution = run_on(surface, quads)
    quality = execution["quality"]
    assert quality.defects == ()
    assert quality.metrics["validity"] == 1
    t = execution["smoothing"].mesh.mesh.topology
    assert np.where(t.on_boundary, 3 - t.valence, 4 - t.valence).sum() == 4 * surface.topology.euler


@settings(max_examples=5, deadline=None, derandomize=True)
@given(bumpy_disks(max_triangles=1500))
def test_any_bumpy_disk_gets_a_sound_mesh(surface):
    check(surface, 300)


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(1, 4), st.integers(0, 2**16))
def test_any_disk_with_limbs_gets_a_sound_mesh(limbs, seed):
    check(limbed_disk(2500, limbs, 2.0, seed), 400)
