"""Wanted sizes: what curvature and the user ask for, how fast they may change, and what the layout makes of them."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.assembly.subdomains import row_heights
from drl_meshgen.decompose import DecomposeOptions, decompose
from drl_meshgen.decompose.stage import predicted_quads
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.hemisphere import hemisphere
from drl_meshgen.pipeline import MeshOptions, mesh_surface
from drl_meshgen.sizing import SizeField, SizeOptions, Sizes, largest_curvature, size_field
from drl_meshgen.sizing.field import gaps
from drl_meshgen.smoothing import SmoothingOptions, optimise
from tests.chains import chain, surface_of, tube
from tests.strategies import flat_disk

SURFACE = surface_of("two limbs")


def scaled(surface: TriMesh, factor: float) -> TriMesh:
    return TriMesh(factor * surface.vertices, surface.triangles)


@pytest.mark.parametrize("radius", [0.1, 1.0, 70.0])
def test_the_curvature_of_a_sphere_is_one_over_its_radius(radius):
    ball = scaled(hemisphere(3000), radius)
    curvature = radius * largest_curvature(ball, 0.05 * radius)
    assert np.median(curvature) == pytest.approx(1, rel=0.03)
    assert curvature == pytest.approx(np.ones(len(curvature)), rel=0.15)


def test_the_curvature_of_a_cylinder_is_that_around_it_and_a_plane_has_none():
    pipe = tube(60, 40, np.full(41, 2.0), np.linspace(0, 8, 41))
    assert np.median(largest_curvature(pipe, 0.1)) == pytest.approx(0.5, rel=0.02)
    assert largest_curvature(flat_disk(500), 0.05).max() < 1e-6


def test_curved_places_want_smaller_quads_within_the_limits():
    options = SizeOptions(curvature=1.0)
    field = size_field(SURFACE, options)
    curvature = largest_curvature(SURFACE, 0.01 * np.sqrt(SURFACE.area))
    order = np.argsort(curvature)
    assert np.all(np.diff(field.factor[order]) <= 1e-12)
    assert field.factor.min() >= options.finest
    assert field.factor.max() <= options.coarsest
    assert np.isnan(field.wanted).all()


def test_factors_do_not_change_with_the_unit():
    options = SizeOptions(curvature=0.7)
    one, other = (size_field(scaled(SURFACE, f), options).factor for f in (1.0, 1000.0))
    np.testing.assert_allclose(one, other, rtol=1e-6)


@pytest.mark.parametrize("gradation", [0.05, 0.3])
def test_sizes_grow_no_faster_than_the_gradation(gradation):
    centre = SURFACE.vertices[SURFACE.vertices[:, 2].argmax()]
    field = size_field(SURFACE, SizeOptions(gradation=gradation, regions=((*centre.tolist(), 0.3, 0.01),)))
    size = field.at(0.2).size
    a, b = SURFACE.topology.edges.T
    assert np.all(np.abs(size[a] - size[b]) <= gradation * SURFACE.edge_lengths + 1e-12)
    assert size.min() == 0.01
    assert size.max() <= 0.2
    near = np.linalg.norm(SURFACE.vertices - centre, axis=1) <= 0.3
    assert np.all(size[near] == 0.01)


def test_later_regions_count_more_than_earlier_ones_and_both_more_than_the_array():
    n, everywhere = len(SURFACE.vertices), (0.0, 0.0, 0.0, 100.0)
    options = SizeOptions(regions=((*everywhere, 0.1), (*everywhere, 0.2)))
    assert np.all(size_field(SURFACE, options, np.full(n, 0.3)).wanted == 0.2)
    assert np.all(size_field(SURFACE, None, np.full(n, 0.3)).wanted == 0.3)


def test_the_edges_asked_for_fit_around_short_loops_and_long_ones_change_nothing():
    loop = SURFACE.vertices[SURFACE.topology.loops[0]]
    length = np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1).sum()
    field = size_field(SURFACE, SizeOptions(around=8), loops=[loop])
    short = field.at(length)
    assert short.length(np.vstack([loop, loop[:1]])) == pytest.approx(8, rel=1e-9)
    assert short.size.max() <= length
    assert field.at(length / 20).uniform
    assert size_field(SURFACE, SizeOptions(around=0), loops=[loop]).at(length).uniform


def rings(heights: list[float]) -> tuple[TriMesh, list[np.ndarray], float]:
    """A tube, its vertices at some heights, and the length of a way along edges per height."""
    pipe = tube(24, 24, np.full(25, 1.0), np.linspace(0, 3, 25))
    way = float(np.linalg.norm(pipe.vertices[24] - pipe.vertices[0])) / 0.125
    return pipe, [np.flatnonzero(np.isclose(pipe.vertices[:, 2], z)) for z in heights], way


def test_the_edges_asked_for_fit_between_near_loops_and_far_ones_change_nothing():
    pipe, (low, high), way = rings([0.0, 0.5])
    loops = [pipe.vertices[low], pipe.vertices[high]]
    for edges in (2, 3):
        wanted = 0.5 * way / edges
        size = size_field(pipe, SizeOptions(around=0, between=edges), loops=loops).at(1.0).size
        assert [size[low].min(), size[high].min(), size.min()] == pytest.approx([wanted] * 3)
        assert size_field(pipe, SizeOptions(around=0, between=edges), loops=loops).at(0.99 * wanted).uniform
    assert size_field(pipe, SizeOptions(around=0, between=0), loops=loops).at(1.0).uniform
    assert size_field(pipe, SizeOptions(around=0), loops=loops[:1]).at(1.0).uniform


def test_each_set_is_as_far_as_the_nearest_other_one_whatever_their_order():
    pipe, sets, way = rings([0.0, 1.0, 3.0])
    for order in ([0, 1, 2], [2, 0, 1]):
        gap = gaps(pipe, [sets[k] for k in order])
        assert [gap[one].min() / way for one in sets] == pytest.approx([1, 1, 2])
    assert not np.isfinite(gaps(pipe, sets[:1])).any()


def test_numbers_that_are_no_lengths_ask_for_nothing():
    given = np.full(len(SURFACE.vertices), 0.3)
    given[:3] = [np.nan, 0.0, -1.0]
    np.testing.assert_array_equal(np.isnan(size_field(SURFACE, None, given).wanted).nonzero()[0], [0, 1, 2])


@pytest.mark.parametrize(
    "wrong", [{"curvature": 1.5}, {"finest": 2.0}, {"gradation": 0.0}, {"regions": ((0.0, 0.0, 0.0, 1.0, -1.0),)}]
)
def test_options_without_a_meaning_are_refused(wrong):
    with pytest.raises(ValueError, match=r"between|positive"):
        SizeOptions(**wrong)


def test_halving_sizes_doubles_lengths_and_quadruples_areas():
    sizes = Sizes.of(SURFACE, 0.1)
    half = replace(sizes, size=sizes.size / 2)
    path = SURFACE.vertices[SURFACE.topology.loops[0]]
    assert half.length(path) == pytest.approx(2 * sizes.length(path))
    assert half.area(SURFACE) == pytest.approx(4 * sizes.area(SURFACE))
    assert sizes.area(SURFACE) == pytest.approx(SURFACE.area / 0.01)


def test_one_size_everywhere_gives_the_layout_of_that_edge_length():
    parts = chain("two limbs")["partition"]
    plain = decompose(parts, DecomposeOptions(target_edge=0.12))
    given = size_field(SURFACE, None, np.full(len(SURFACE.vertices), 0.12))
    field = decompose(parts, DecomposeOptions(target_quads=10_000), given)
    np.testing.assert_array_equal(plain.curve_counts, field.curve_counts)
    np.testing.assert_array_equal(np.concatenate(plain.edge_counts), np.concatenate(field.edge_counts))
    np.testing.assert_array_equal(plain.tube_rows, field.tube_rows)
    assert field.spacing == pytest.approx(0.12)


def test_a_field_of_ones_changes_nothing():
    parts, options = chain("four limbs")["partition"], DecomposeOptions(target_quads=700)
    plain, field = decompose(parts, options), decompose(parts, options, SizeField.uniform(surface_of("four limbs")))
    np.testing.assert_array_equal(plain.curve_counts, field.curve_counts)
    assert plain.spacing == field.spacing
    ring = plain.pieces.rings[0]
    np.testing.assert_array_equal(row_heights(ring, 5, Sizes.of(ring.mesh, 0.3)), np.arange(6) / 5)


def test_the_number_of_quads_is_met_whatever_the_field():
    parts = chain("two limbs")["partition"]
    centre = SURFACE.vertices[SURFACE.vertices[:, 2].argmax()].tolist()
    for options in (SizeOptions(curvature=1.0), SizeOptions(regions=((*centre, 0.5, 0.03),))):
        field = size_field(SURFACE, options)
        layout = decompose(parts, DecomposeOptions(target_quads=3000), field)
        assert predicted_quads(layout, field.at(layout.spacing)) == pytest.approx(3000, rel=0.1)


def test_rows_are_closer_where_sizes_are_small():
    ring = chain("two limbs")["decompose"].pieces.tubes[0].ring
    small_at_start = Sizes(ring.mesh.vertices, 0.1 + 0.2 * ring.chart.h)
    heights = row_heights(ring, 12, small_at_start)
    assert heights[0] == 0
    assert heights[-1] == 1
    assert np.all(np.diff(heights) > 0)
    assert np.all(np.diff(heights, 2) > -1e-3)
    assert np.diff(heights)[-1] > 1.4 * np.diff(heights)[0]


def quads_within(mesh, centre, radius):
    return int((np.linalg.norm(mesh.points[mesh.quads].mean(axis=1) - centre, axis=1) < radius).sum())


def test_half_the_size_at_the_end_of_a_limb_gives_it_about_four_times_the_quads():
    centre, radius = SURFACE.vertices[SURFACE.vertices[:, 2].argmax()], 0.7
    options = replace(MeshOptions().sized(target_edge=0.2), smoothing=SmoothingOptions(size_weight=1.0))
    number = []
    for size in (0.15, 0.075):
        sizing = SizeOptions(gradation=1.0, regions=((*centre.tolist(), radius, size),))
        number.append(quads_within(mesh_surface(SURFACE, replace(options, sizing=sizing)).mesh, centre, radius))
    assert number[1] / number[0] == pytest.approx(4, rel=0.3)


def test_the_optimiser_moves_nodes_to_where_sizes_are_small():
    run = chain("disk")
    surface, lifted = run["cleanup"].surface, run["lift"]
    size = 0.05 + 0.2 * (surface.vertices[:, 0] > 0)
    options = SmoothingOptions()
    left = []
    for sizes in (None, size):
        points = optimise(surface, lifted.mesh.mesh, lifted.triangle, options, sizes=sizes).points
        left.append((points[lifted.mesh.mesh.quads].mean(axis=1)[:, 0] < 0).mean())
    assert left[1] > left[0] + 0.1
