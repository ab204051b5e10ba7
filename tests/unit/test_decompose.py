"""The layout: counts agree wherever pieces meet, and the mesh gets about as many quads as wanted."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.decompose import DecomposeOptions, decompose
from drl_meshgen.decompose.stage import predicted_quads
from drl_meshgen.partition import RegionKind
from tests.chains import SURFACES, chain, run_on, surface_of
from tests.strategies import rigidly_moved


@pytest.fixture(params=SURFACES)
def run(request):
    return chain(request.param)


def test_every_region_becomes_one_piece(run):
    pieces, kinds = run["decompose"].pieces, [region.kind for region in run["partition"].regions]
    assert len(pieces.junctions) == kinds.count(RegionKind.JUNCTION)
    assert len(pieces.tubes) == kinds.count(RegionKind.TUBE)
    assert len(pieces.caps) == kinds.count(RegionKind.CAP)
    area = sum(ring.mesh.area for ring in pieces.rings) + sum(disk.mesh.area for disk in (*pieces.caps, *pieces.strips))
    assert area == pytest.approx(run["cleanup"].surface.area, rel=1e-9)


def test_counts_agree_on_loops_and_at_both_ends_of_tubes_and_are_even_on_caps(run):
    layout, options = run["decompose"], DecomposeOptions()
    for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True):
        assert counts.min() >= options.least_columns
        for curve, cell in zip(junction.curves, junction.cells, strict=True):
            assert layout.curve_counts[curve] == sum(counts[e] for e, _ in cell.sides)
    for tube in layout.pieces.tubes:
        assert layout.curve_counts[tube.curves[0]] == layout.curve_counts[tube.curves[1]]
    for cap in layout.pieces.caps:
        assert layout.curve_counts[cap.curve] % 2 == 0
        assert layout.curve_counts[cap.curve] >= options.least_cap


def test_every_ring_has_its_least_rows(run):
    layout = run["decompose"]
    assert all(rows.min() >= DecomposeOptions.least_rows for rows in layout.cell_rows)
    assert layout.tube_rows.min(initial=1) >= 1


def test_rings_start_at_their_curve_and_their_origin_is_on_it(run):
    parts, pieces = run["partition"], run["decompose"].pieces
    for junction in pieces.junctions:
        for curve, cell in zip(junction.curves, junction.cells, strict=True):
            known = cell.ring.origin[cell.ring.inner]
            assert set(known[known >= 0].tolist()) == set(parts.curves[curve].vertices.tolist())
    for tube in pieces.tubes:
        for curve, loop in zip(tube.curves, (tube.ring.inner, tube.ring.outer), strict=True):
            assert set(tube.ring.origin[loop].tolist()) == set(parts.curves[curve].vertices.tolist())
    for cap in pieces.caps:
        assert set(cap.origin[cap.loop].tolist()) == set(parts.curves[cap.curve].vertices.tolist())


def test_the_prediction_counts_rings_and_strips_exactly(run):
    layout = run["decompose"]
    fills = run["subdomain"]
    exact = sum((len(fill.chart) - 1) * fill.chart.shape[1] for fill in fills.rings)
    exact += sum((len(fill.chart) - 1) * (fill.chart.shape[1] - 1) for fill in fills.strips)
    alone = replace(layout, pieces=replace(layout.pieces, caps=()))
    assert predicted_quads(alone) == exact


def test_a_wanted_edge_length_is_taken_as_it_is():
    parts = chain("two limbs")["partition"]
    for edge in (0.1, 0.2):
        assert decompose(parts, DecomposeOptions(target_edge=edge)).spacing == edge


def test_more_quads_are_predicted_where_more_are_wanted():
    parts = chain("two limbs")["partition"]
    for wanted in (400, 1600, 6400):
        layout = decompose(parts, DecomposeOptions(target_quads=wanted))
        assert predicted_quads(layout) == pytest.approx(wanted, rel=0.15)


def test_the_layout_of_a_moved_surface_is_the_same():
    one = chain("two limbs")["decompose"]
    moved = run_on(rigidly_moved(surface_of("two limbs"), seed=3, scale=50.0), SURFACES["two limbs"][1])["decompose"]
    np.testing.assert_array_equal(one.curve_counts, moved.curve_counts)
    for a, b in zip(one.edge_counts, moved.edge_counts, strict=True):
        np.testing.assert_array_equal(a, b)
    assert moved.spacing == pytest.approx(50 * one.spacing, rel=1e-9)
