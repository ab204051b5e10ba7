"""Strips: a spanning tree of four-sided patches between loops, one ring around, nodes of valence 5 at their corners."""

import numpy as np
import pytest

from drl_meshgen.decompose import opening
from drl_meshgen.decompose.junction import Rim
from drl_meshgen.decompose.opening import open_junction, ranked
from drl_meshgen.decompose.spine import loop_distances
from drl_meshgen.decompose.strips import WIDTHS, open_strips, strip_graph
from drl_meshgen.decompose.trial import mean_orthogonality, trial_quads
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.partition import Curve
from drl_meshgen.partition.cutting import midpoint_refined
from tests.chains import chain, grid, run_on
from tests.strategies import limbed_disk, rigidly_moved

LOOPS = (3, 4, 6, 9)


@pytest.fixture(params=LOOPS, ids=lambda k: f"plate with {k} loops")
def laid(request):
    k = request.param
    mesh = midpoint_refined(midpoint_refined(grid(6 * k, 8, k - 1)))
    loops = mesh.topology.loops
    outer = int(np.argmax([len(loop) for loop in loops]))
    strips = strip_graph(mesh, loops, loop_distances(mesh, loops), outer, WIDTHS[0])
    assert strips is not None
    return mesh, loops, outer, strips, k


def plate_candidates(monkeypatch, k=4, **options):
    """Candidates that `open_junction` ranks, on a plate."""
    monkeypatch.setattr(opening, "ranked", list)
    mesh = grid(6 * k, 8, k - 1)
    curves = {c: Curve(loop, True, 0.0) for c, loop in enumerate(mesh.topology.loops)}
    return open_junction(mesh, np.arange(len(mesh.vertices)), curves, (0.0, 1.0), **options)


def test_only_coarse_junctions_are_refined_before_they_are_opened(monkeypatch):
    coarse = plate_candidates(monkeypatch, strips=False)
    monkeypatch.setattr(opening, "FINE", 0)
    fine = plate_candidates(monkeypatch, strips=False)
    faces = [sum(len(cell.ring.mesh.triangles) for cell in junctions[0].cells) for junctions in (coarse, fine)]
    assert faces[0] == 4 * faces[1]


def test_k_loops_take_k_minus_two_strips_with_four_corners_each(laid):
    _, _, _, strips, k = laid
    assert len(strips.quads) == k - 2
    assert len(strips.graph.nodes) == 4 * (k - 2)


def test_strips_join_all_inner_loops(laid):
    _, loops, outer, strips, k = laid
    at = {int(v): l for l, loop in enumerate(loops) for v in loop}
    ends = [
        tuple(at[int(strips.graph.paths[quad[n]][0])] for n in (0, 2))  # the loops of both mouths
        for quad in strips.quads
    ]
    together = {ends[0][0]}
    for _ in range(k):
        together |= {l for pair in ends if together & set(pair) for l in pair}
    assert together == set(range(k)) - {outer}


def test_rims_go_once_around_every_inner_loop(laid):
    mesh, loops, outer, strips, _ = laid
    assert strips.rims[outer] == ()
    for l, sides in enumerate(strips.rims):
        if l != outer:
            walk = np.concatenate([strips.graph.paths[e][:-1] for e in sides])
            start = int(np.nonzero(walk == loops[l][0])[0][0])
            np.testing.assert_array_equal(np.roll(walk, -start), loops[l])
    on_loop = mesh.topology.on_boundary
    for quad in strips.quads:
        for side in (quad[1], quad[3]):
            assert not on_loop[strips.graph.paths[side][1:-1]].any()


def test_sides_do_not_touch_each_other(laid):
    _, _, _, strips, _ = laid
    used = np.concatenate([strips.graph.paths[quad[n]] for quad in strips.quads for n in (1, 3)])
    assert len(np.unique(used)) == len(used)


def test_what_the_strips_leave_is_one_ring_around_the_outer_loop(laid):
    mesh, loops, outer, strips, _ = laid
    found = open_strips(mesh, strips, loops, outer)
    assert found is not None
    cell, patches = found
    assert set(cell.ring.origin[cell.ring.inner].tolist()) == set(loops[outer].tolist())
    assert cell.ring.mesh.area + sum(strip.mesh.area for strip in patches) == pytest.approx(mesh.area, rel=1e-12)
    sides = [q[n] for q in strips.quads for n in (1, 3)]
    arcs = set(range(len(strips.graph.paths))) - {e for q in strips.quads for e in q}
    assert sorted(e for e, _ in cell.sides) == sorted([*sides, *arcs])


def test_every_strip_maps_to_the_unit_square_without_folds(laid):
    mesh, loops, outer, strips, _ = laid
    for strip in open_strips(mesh, strips, loops, outer)[1]:
        a, b, c = (strip.plane[strip.mesh.triangles[:, n]] for n in range(3))
        area = np.linalg.det(np.stack([b - a, c - a], axis=-1)) / 2
        assert area.min() >= -1e-12
        assert area.sum() == pytest.approx(1)
        assert Topology(len(strip.plane), strip.mesh.triangles).euler == 1


def test_strips_do_not_fit_between_loops_of_few_edges():
    mesh = grid(18, 8, 2)
    assert strip_graph(mesh, mesh.topology.loops, loop_distances(mesh, mesh.topology.loops), 0, WIDTHS[0]) is None


@pytest.mark.parametrize("direction", [1, -1])
def test_nodes_of_a_rim_are_equally_spaced_between_corners(direction):
    rim = Rim(0, (2, 0, 1), direction * np.array([0.3, 0.5, 1.1]))
    places = direction * rim.natural(np.array([3, 2, 4]))
    np.testing.assert_allclose(places, [0.3, 0.35, 0.4, 0.45, 0.5, 0.7, 0.9, 1.1, 1.2])


def test_a_plate_is_opened_along_its_spine_where_strips_are_not_wanted(monkeypatch):
    assert not any(one.strips for one in plate_candidates(monkeypatch, strips=False))
    assert sum(bool(one.strips) for one in plate_candidates(monkeypatch, strips=True)) == 1


def test_strips_win_on_a_plate_whose_spine_slants_and_lose_when_distorted(monkeypatch):
    found = plate_candidates(monkeypatch, strips=True)
    assert ranked(found)[0].strips
    monkeypatch.setattr(opening, "MOST_DISTORTION", -1.0)
    distortion = [one.distortion for one in ranked(found)]
    assert distortion == sorted(one.distortion for one in found if not one.strips)


def test_strips_that_lose_the_trial_come_second(monkeypatch):
    found = plate_candidates(monkeypatch, strips=True)
    monkeypatch.setattr(opening, "STRIP_MARGIN", 1.0)
    assert [bool(one.strips) for one in ranked(found)] == [False, True, False]


def test_trial_quads_cover_the_junction_whichever_way_it_is_opened(monkeypatch):
    found = plate_candidates(monkeypatch, strips=True)
    for junction in found:
        quads = trial_quads(junction)
        cross = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])[:, 2] / 2
        total = sum(c.ring.mesh.area for c in junction.cells) + sum(s.mesh.area for s in junction.strips)
        assert cross.sum() == pytest.approx(total, rel=0.1)


def test_orthogonality_of_squares_is_one_and_of_rhombi_two_thirds():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    rhombus = np.array([[0, 0, 0], [1, 0, 0], [1.5, np.sqrt(0.75), 0], [0.5, np.sqrt(0.75), 0]])
    assert mean_orthogonality(square[None]) == pytest.approx(1)
    assert mean_orthogonality(rhombus[None]) == pytest.approx(2 / 3)
    assert mean_orthogonality(np.stack([square, rhombus])) == pytest.approx(5 / 6)


def test_a_plate_with_holes_needs_no_irregular_node():
    mesh = chain("plate with holes")["smoothing"].mesh
    assert chain("plate with holes")["decompose"].pieces.strips
    assert not mesh.mesh.irregular.any()


def test_strips_over_caps_make_nodes_of_valence_five(monkeypatch):
    monkeypatch.setattr(opening, "ranked", lambda found: tuple(sorted(found, key=lambda one: not one.strips)))
    done = run_on(limbed_disk(3000, 3, 2.5, seed=1), 700, ["lift"], candidates=1)
    pieces, mesh = done["decompose"].pieces, done["lift"].mesh.mesh
    corners = 4 * len(pieces.strips)
    valence = np.bincount(mesh.topology.valence[mesh.irregular], minlength=7)
    assert corners > 0
    assert valence[5] == corners
    assert valence[3] == 4 * len(pieces.caps)
    assert mesh.topology.euler == done["cleanup"].surface.topology.euler


def test_counts_of_strips_agree_on_opposite_sides_and_rims_fill_their_curves():
    layout = chain("plate with holes")["decompose"]
    for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True):
        for strip in junction.strips:
            mouth, side, far, back = counts[list(strip.sides)]
            assert (mouth, side) == (far, back)
        for rim in junction.rims:
            assert counts[list(rim.sides)].sum() == layout.curve_counts[rim.curve]


@pytest.mark.parametrize(("seed", "scale"), [(1, 1.0), (2, 1e-6), (3, 1e4)])
def test_the_first_mesh_of_a_moved_plate_is_the_moved_mesh(seed, scale):
    """Symmetric meshes have many paths of equal length: order decides, not rounding."""
    shape, one = grid(24, 12, holes=3), chain("plate with holes")
    two = run_on(rigidly_moved(shape, seed, scale), 400, ["lift"])
    assert [s.sides for s in one["decompose"].pieces.strips] == [s.sides for s in two["decompose"].pieces.strips]
    for a, b in zip(one["lift"].mesh.grids, two["lift"].mesh.grids, strict=True):
        np.testing.assert_array_equal(a, b)
    lengths = [np.linalg.norm(np.diff(run["lift"].mesh.points[grid], axis=0), axis=-1) for run in (one, two)
               for grid in run["lift"].mesh.grids]  # fmt: skip
    half = len(lengths) // 2
    for a, b in zip(lengths[:half], lengths[half:], strict=True):
        np.testing.assert_allclose(b, scale * a, rtol=1e-6)
