"""Opening surfaces along seams: what comes out has no handles and a boundary; seams lie where they are short."""

from pathlib import Path

import numpy as np
import pytest

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.cutgraph import corners_left_of
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.models.reading import read_surface
from drl_meshgen.seams import SeamKind, open_surface
from drl_meshgen.seams.loops import LoopFinder, separates
from tests.chains import grid
from tests.solids import pierced_plate, side_by_side, sphere, spindle, tapered_torus, voxel_surface
from tests.strategies import flat_disk, reordered, rigidly_moved

CLOSED = Path(__file__).resolve().parents[3] / "shared/models/closed"


def dumbbell():
    z = np.linspace(-3, 3, 61)
    radius = np.where(np.abs(z) > 1, np.sqrt(np.maximum(1.02 - (np.abs(z) - 2) ** 2, 0.01)), 0.4 + 0.2 * np.abs(z))
    return spindle(radius, z)


def rings():
    full = np.ones((9, 9, 3), bool)
    full[3:6, 3:6] = False
    return voxel_surface(full)


SURFACES = {  # the surface, handles, seams around closed components
    "torus": (tapered_torus, 1, 0),
    "torus of three edges around": (lambda: grid(12, 3, torus=True), 1, 0),
    "smallest torus": (lambda: grid(3, 3, torus=True), 1, 0),
    "torus with three holes": (lambda: grid(24, 12, holes=3, torus=True), 1, 0),
    "torus with holes all around": (lambda: grid(12, 6, holes=6, torus=True), 1, 0),
    "frame": (rings, 1, 0),
    "double torus": (lambda: pierced_plate(2), 2, 0),
    "five handles of few triangles": (lambda: pierced_plate(5, wide=2), 5, 0),
    "sphere": (sphere, 0, 1),
    "dumbbell": (dumbbell, 0, 1),
    "components": (lambda: side_by_side(flat_disk(300), sphere(8), tapered_torus(20, 8), sphere(12)), 1, 2),
}


def check(surface: TriMesh, handles: int, closed: int):
    """Open a surface and check everything the interface promises."""
    opened = open_surface(surface)
    mesh, topology = opened.mesh, opened.mesh.topology
    n, label = topology.components
    assert n == surface.topology.components[0] + closed
    for c in range(n):
        piece = Topology(len(mesh.vertices), mesh.triangles[label == c])
        assert piece.loops
        assert piece.euler + len(piece.loops) == 2
    assert [seam.kind for seam in opened.seams].count(SeamKind.HANDLE) == handles
    assert [seam.kind for seam in opened.seams].count(SeamKind.WAIST) == closed
    assert topology.edge_count.max() == 2
    assert not len(topology.misoriented_edges)
    assert topology.used.all()
    # each side of a seam is a whole loop, one along its mesh, the other against it
    loops = {loop.tobytes() for loop in topology.loops}
    start = lambda loop: np.roll(loop, -int(np.argmin(loop))).tobytes()  # noqa: E731
    for seam in opened.seams:
        np.testing.assert_array_equal(mesh.vertices[seam.left], mesh.vertices[seam.right])
        assert start(seam.left) in loops
        assert start(seam.right[::-1]) in loops
    assert len(loops) == len(surface.topology.loops) + 2 * len(opened.seams)
    # triangles are parts of their parents
    area = np.bincount(opened.parent, mesh.areas, len(surface.triangles))
    np.testing.assert_allclose(area, surface.areas, rtol=1e-9)
    np.testing.assert_allclose(mesh.normals, surface.normals[opened.parent], atol=1e-6)
    assert list(opened.table.nodes) == [len(seam.left) for seam in opened.seams]
    lengths = [closed_length(mesh.vertices[seam.left]) for seam in opened.seams]
    np.testing.assert_allclose(opened.table.length, lengths)
    return opened


@pytest.mark.parametrize("name", SURFACES)
def test_every_component_gets_genus_0_and_a_boundary(name):
    build, handles, closed = SURFACES[name]
    check(build(), handles, closed)


@pytest.mark.skipif(not CLOSED.is_dir(), reason="needs the shared surfaces")
@pytest.mark.parametrize(("name", "handles"), [("g1_torus", 1), ("cat", 0)])
def test_real_closed_surfaces_are_opened(name, handles):
    raw = read_surface(CLOSED / f"{name}.ply")
    check(TriMesh(raw.points, raw.triangles), handles, int(handles == 0))


def test_a_surface_with_a_boundary_and_no_handle_comes_back_as_it_is():
    disk = flat_disk(300)
    opened = open_surface(disk)
    assert opened.mesh is disk
    np.testing.assert_array_equal(opened.parent, np.arange(len(disk.triangles)))
    assert opened.seams == ()
    assert opened.table.empty


def test_the_seam_of_a_torus_goes_around_its_tube_where_it_is_thin():
    opened = open_surface(tapered_torus(thin=0.5))
    seam = opened.mesh.vertices[opened.seams[0].left]
    assert closed_length(seam) == pytest.approx(np.pi, rel=0.03)
    assert (seam[:, 0] > 2.4 * np.abs(seam[:, 1])).all()


def test_the_seam_of_a_dumbbell_goes_around_its_bar():
    opened = open_surface(dumbbell())
    seam = opened.mesh.vertices[opened.seams[0].left]
    assert np.abs(seam[:, 2]).max() < 0.3
    assert np.ptp(seam[:, 2]) < 0.05


def test_the_seam_of_a_sphere_leaves_a_good_share_on_both_sides():
    opened = open_surface(sphere())
    area = np.bincount(opened.mesh.topology.components[1], opened.mesh.areas)
    assert area.min() > 0.15 * area.sum()


def test_seams_keep_off_the_boundary():
    surface = grid(24, 12, holes=3, torus=True)
    opened = open_surface(surface)
    rim = np.asarray(surface.topology.on_boundary)
    beside = rim[surface.triangles].any(axis=1)
    on_seam = np.zeros(len(opened.mesh.vertices), bool)
    on_seam[opened.seams[0].left] = True
    touching = np.nonzero(on_seam[opened.mesh.triangles].any(axis=1))[0]
    assert not beside[opened.parent[touching]].any()


def test_seams_follow_motion_scale_and_numbering():
    # not to the last digit: the two sides of a symmetric surface are a tie that rounding decides
    surface = tapered_torus(40, 16)
    length = open_surface(surface).table.length[0]
    moved = open_surface(rigidly_moved(surface, seed=3, scale=7.0))
    assert moved.table.length[0] == pytest.approx(7 * length, rel=0.03)
    shuffled = open_surface(reordered(surface, seed=2)[0])
    assert shuffled.table.length[0] == pytest.approx(length, rel=0.03)


def test_opening_twice_gives_the_same_bits():
    surface = side_by_side(sphere(10), pierced_plate(2, wide=3))
    one, two = open_surface(surface), open_surface(surface)
    np.testing.assert_array_equal(one.mesh.vertices, two.mesh.vertices)
    np.testing.assert_array_equal(one.mesh.triangles, two.mesh.triangles)


@pytest.mark.parametrize("name", ["torus", "double torus", "torus with three holes"])
def test_shortest_paths_close_two_loops_for_each_handle_and_none_separates(name):
    build, handles, _ = SURFACES[name]
    mesh = build()
    finder = LoopFinder(mesh)
    (source,) = finder.sources(1)
    loops = finder.through(source)
    assert len(loops) == 2 * handles
    for loop in loops:
        assert len(set(loop.tolist())) == len(loop)
        assert finder.has(loop)
        assert not separates(mesh, loop)
        assert not mesh.topology.on_boundary[loop].any()


def test_corners_at_a_loop_are_on_its_left_or_on_the_left_of_its_reverse():
    mesh = tapered_torus(20, 8)
    loop = np.arange(8)
    left = corners_left_of(mesh.topology, loop, closed=True)
    right = corners_left_of(mesh.topology, loop[::-1], closed=True)
    np.testing.assert_array_equal(left ^ right, np.isin(mesh.triangles, loop))
    assert not (left & right).any()
