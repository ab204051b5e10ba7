"""Bands and caps turned so that mesh lines meet, and blocks with 1-to-1 interfaces."""

from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.assembly import AssemblyOptions, assemble, fill
from drl_meshgen.decompose.lines import Lines, Turning, united
from drl_meshgen.decompose.stage import DecomposeOptions, predicted_blocks, with_counts
from drl_meshgen.errors import InputError
from drl_meshgen.export import block_edges
from drl_meshgen.mesh import BlockMesh
from drl_meshgen.quality.base_complex import base_complex
from drl_meshgen.quality.structure import t_junctions
from tests.chains import SURFACES, chain

JOINED = [name for name in SURFACES if name != "bumps"]


def assembled(run, layout, **options):
    assembly = assemble(layout, fill(run["partition"], layout), AssemblyOptions(**options))
    return BlockMesh(np.zeros((len(assembly.piece), 3)), assembly.grids)


def with_turning(layout, seed):
    """Return the layout with bands and caps turned at random."""
    rng = np.random.default_rng(seed)
    lines = Lines.of(layout.pieces, len(layout.curve_counts))
    around = [int(layout.curve_counts[band.curves[0]]) for band in lines.bands]
    corners = [(0, 1)] * len(layout.pieces.caps)
    for band, n in zip(lines.bands, around, strict=True):
        if band.cap >= 0:
            corners[band.cap] = (int(rng.integers(n)), int(rng.integers(1, n // 2)))
    shifts = tuple(int(rng.integers(n)) for n in around)
    return replace(layout, turning=Turning(shifts, tuple(corners)))


@pytest.mark.parametrize("name", SURFACES)
def test_the_count_of_patches_is_that_of_the_base_complex_of_the_mesh(name):
    run = chain(name)
    layout = run["decompose"]
    mesh = assembled(run, layout)
    assert predicted_blocks(layout) == base_complex(mesh.mesh).max() + 1


@pytest.mark.parametrize("name", ["four limbs", "plate with holes"])
@pytest.mark.parametrize("seed", range(3))
def test_however_bands_and_caps_are_turned_the_count_is_that_of_the_mesh(name, seed):
    run = chain(name)
    layout = with_turning(run["decompose"], seed)
    assert predicted_blocks(layout) == base_complex(assembled(run, layout).mesh).max() + 1


@pytest.mark.parametrize("name", SURFACES)
def test_blocks_are_the_base_complex_and_every_interface_is_one_to_one(name):
    mesh = chain(name)["smoothing"].mesh
    assert len(mesh.grids) == base_complex(mesh.mesh).max() + 1
    assert len(t_junctions(mesh.mesh, mesh.block)) == 0
    edges = block_edges(mesh)
    assert edges["whole"].all()
    inner = edges[edges["kind"] == "interface"]
    assert 2 * len(inner) + (edges["kind"] == "boundary").sum() == 4 * len(mesh.grids)


@pytest.mark.parametrize("name", ["four limbs"])
def test_bands_are_kept_where_the_base_complex_has_too_many_blocks(name):
    run = chain(name)
    layout = with_turning(run["decompose"], 0)
    many, few = (assembled(run, layout, most_blocks=most) for most in (10**6, 1))
    assert len(few.grids) < len(many.grids)
    assert len(t_junctions(few.mesh, few.block)) > 0
    assert not block_edges(few)["whole"].all()


def test_turning_lowers_the_number_of_blocks_and_keeps_the_irregular_nodes():
    run = chain("four limbs")
    pieces, options = run["decompose"].pieces, DecomposeOptions(target_quads=1000)
    plain, turned = (
        assembled(run, with_counts(run["partition"], pieces, replace(options, block_weight=weight)))
        for weight in (0.0, 1.0)
    )
    assert len(turned.grids) < len(plain.grids)
    valence = [np.sort(m.mesh.topology.valence[m.mesh.irregular]).tolist() for m in (plain, turned)]
    assert valence[0] == valence[1]


@pytest.mark.parametrize("name", JOINED)
def test_turned_counts_still_solve_the_count_problem(name):
    layout = chain(name)["decompose"]
    counts = layout.curve_counts
    for tube in layout.pieces.tubes:
        assert counts[tube.curves[0]] == counts[tube.curves[1]]
    for cap in layout.pieces.caps:
        assert counts[cap.curve] % 2 == 0
    for junction, edges in zip(layout.pieces.junctions, layout.edge_counts, strict=True):
        assert edges.min() >= DecomposeOptions().least_columns
        for curve, cell in zip(junction.curves, junction.cells, strict=True):
            assert counts[curve] == sum(edges[e] for e, _ in cell.sides)
        for rim in junction.rims:
            assert counts[rim.curve] == sum(edges[e] for e in rim.sides)
        for strip in junction.strips:
            a, b, c, d = (edges[e] for e in strip.sides)
            assert (a, b) == (c, d)


def test_the_search_gives_the_same_layout_every_time():
    run = chain("four limbs")
    options = DecomposeOptions(target_quads=1000)
    one, two = (with_counts(run["partition"], run["decompose"].pieces, options) for _ in range(2))
    assert one.turning == two.turning
    np.testing.assert_array_equal(one.curve_counts, two.curve_counts)


def test_a_layout_that_nobody_turned_has_no_count_of_blocks():
    layout = replace(chain("two limbs")["decompose"], turning=None)
    with pytest.raises(InputError, match="block_weight"):
        predicted_blocks(layout)


def test_classes_of_joined_numbers_are_in_order():
    assert united(6, [(4, 1), (5, 4), (2, 3)]) == [(0,), (1, 4, 5), (2, 3)]
    assert united(0, []) == []
