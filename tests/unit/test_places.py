"""Errors say where on the surface they are, and the place is drawn."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.cleanup import repair
from drl_meshgen.errors import InputError, Place, StageError
from drl_meshgen.mesh import QuadMesh
from drl_meshgen.models import RawSurface
from drl_meshgen.pipeline import STAGES, CleanupOptions
from drl_meshgen.quality import QuadShape
from drl_meshgen.quality.shape import own_normals
from drl_meshgen.report.palette import WORST
from drl_meshgen.report.places import draw_place, worst_quads
from drl_meshgen.ricci import Outcome, RicciOptions, solve
from tests.standins import hemisphere, hemisphere_ogrid
from tests.strategies import bumpy_disk
from tests.unit.test_bad_input_cli import strip


def reddish(image):
    red, green, blue = np.moveaxis(image.astype(int), -1, 0)
    return (red > 150) & (green < 110) & (blue < 110)


def moebius():
    points, triangles = strip(1)
    return RawSurface("band", points, triangles)


def test_an_error_of_a_stage_knows_the_surface_and_the_points_are_on_it():
    raw = moebius()
    with pytest.raises(InputError) as caught:
        STAGES[1].run({"model": raw}, CleanupOptions())
    place = caught.value.place
    assert np.array_equal(place.vertices, raw.points)
    assert len(place.points) < len(raw.points) / 2
    assert (np.linalg.norm(place.points[:, None] - raw.points, axis=2).min(axis=1) == 0).all()


def test_cutting_where_neighbours_disagree_leaves_a_band_with_two_sides():
    points, triangles = strip(1)
    ids = repair.disagreeing(len(points), np.asarray(triangles))
    kept = np.asarray(triangles)[~np.isin(triangles, ids).any(axis=1)]
    assert len(kept)
    assert not repair.orient(len(points), kept)[2].any()


def test_nothing_disagrees_on_a_band_with_two_sides():
    points, triangles = strip(0)
    assert len(repair.disagreeing(len(points), np.asarray(triangles))) == 0


def test_ricci_names_its_worst_vertices():
    surface = bumpy_disk(60, seed=1, height=0.8)
    with pytest.raises(StageError) as caught:
        solve(surface, RicciOptions(max_steps=1))
    assert caught.value.outcome is Outcome.MAX_STEPS
    result = solve(surface, RicciOptions(max_steps=1), throw=False)
    error = np.abs(result.curvature - result.target)
    worst = result.worst(5)
    assert error[worst[0]] == error.max()
    assert np.array_equal(caught.value.where[:5], surface.vertices[worst])


@pytest.mark.parametrize(
    "error",
    [
        InputError("a.ply", "is no good", "try another", where=np.ones((2, 3))),
        StageError("ricci", Outcome.STALLED, "detail", where=np.ones((2, 3))),
        InputError("a.ply", "is no good"),
    ],
)
def test_errors_travel_between_processes_with_their_place(error):
    if error.where is not None:
        error.place = Place(error.where, np.eye(3), np.array([[0, 1, 2]]))
    back = pickle.loads(pickle.dumps(error))
    assert (type(back), str(back), back.exit_code) == (type(error), str(error), error.exit_code)
    assert (back.where is None) == (error.where is None)
    if error.place is not None:
        assert all(np.array_equal(a, b) for a, b in zip(back.place, error.place, strict=True))


def test_the_picture_shows_red_in_both_halves_and_grey_around_it():
    surface = hemisphere(8)
    image = draw_place(Place(surface.vertices[surface.triangles[7]], surface.vertices, surface.triangles), side=200)
    left, right = reddish(image[:, :200]), reddish(image[:, -200:])
    assert 0 < left.mean() < 0.1
    assert 0 < right.mean() < 0.5
    assert right[70:130, 70:130].any()


def test_any_unit_and_any_unused_vertex_give_a_picture():
    surface = hemisphere(8)
    for scale in (1e-9, 1e9):
        points = np.r_[scale * surface.vertices, [[np.nan] * 3]]
        assert reddish(draw_place(Place(points[:1], points, surface.triangles), side=100)).any()


def test_a_place_without_points_is_refused():
    surface = hemisphere(8)
    with pytest.raises(ValueError, match="needs a point"):
        draw_place(Place(np.zeros((0, 3)), surface.vertices, surface.triangles))


def test_the_worst_quads_are_those_the_gate_objects_to_else_the_worst_one():
    mesh = hemisphere_ogrid().mesh
    shape = QuadShape(mesh.points[mesh.quads], own_normals(mesh.points[mesh.quads]))
    assert len(worst_quads(mesh, shape).points) == 1
    folded = mesh.quads.copy()
    folded[[3, 9]] = folded[[3, 9]][:, [0, 2, 1, 3]]
    bad = replace(shape, corners=mesh.points[folded])
    centres = worst_quads(QuadMesh(mesh.points, folded), bad).points
    assert {tuple(p) for p in centres} == {tuple(p) for p in mesh.points[folded[[3, 9]]].mean(axis=1)}


def test_the_red_of_pictures_is_the_one_of_the_page():
    assert reddish(np.array([[[int(WORST[k : k + 2], 16) for k in (1, 3, 5)]]])).all()
