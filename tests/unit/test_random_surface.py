import numpy as np
import pytest

from drl_meshgen.cleanup.repair import drop_duplicates, trim_fins
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import load
from drl_meshgen.models.flaws import FLAWS
from drl_meshgen.models.random_body import MOST_OPENINGS, drawn_body
from drl_meshgen.models.random_surface import random_surface
from drl_meshgen.pipeline import MeshOptions, run
from tests.standins import hemisphere

SEEDS = range(8)


@pytest.fixture(scope="module")
def dome():
    return hemisphere(12)


@pytest.mark.parametrize("seed", SEEDS)
def test_facts_of_a_random_surface_are_consistent_and_within_their_ranges(seed):
    made = random_surface(seed)
    assert 3_000 * 0.8 <= len(made.surface.triangles) <= 15_000
    assert made.limbs >= 2 * made.components
    assert 1 <= made.components <= 3
    assert made.genus >= 0
    assert 0 <= made.loops <= 2 * MOST_OPENINGS * made.components
    assert np.isfinite(made.surface.points).all()
    if not made.flaws:
        t = TriMesh(made.surface.points, made.surface.triangles).topology
        assert t.edge_count.max() == 2
        assert len(t.misoriented_edges) == 0
        assert t.euler == 2 * made.components - 2 * made.genus - made.loops


def test_one_seed_gives_one_surface_and_another_seed_another():
    first = random_surface(2).surface
    random_surface.cache_clear()
    again, other = random_surface(2).surface, random_surface(3).surface
    assert again.points.tobytes() == first.points.tobytes()
    assert again.triangles.tobytes() == first.triangles.tobytes()
    assert len(other.points) != len(first.points)


def test_random_surfaces_are_models_by_name():
    assert load("random:2").triangles.tobytes() == random_surface(2).surface.triangles.tobytes()
    assert load("random:2", triangles=17).name == "random-2"
    for name in ("random:", "random:x", "random:-1", "random:1.5"):
        with pytest.raises(InputError, match="whole number"):
            load(name)


def test_a_random_surface_goes_through_the_pipeline():
    made = random_surface(5)
    assert (made.genus, made.components) == (0, 1)
    metrics = run("random:5", MeshOptions().sized(2000))["quality"].metrics
    assert metrics["validity"] == 1
    assert (metrics["loops"], metrics["euler"]) == (made.loops, 2 - made.loops)


def test_bodies_draw_every_kind_within_their_ranges():
    bodies = [drawn_body(np.random.default_rng(seed), closed=False) for seed in range(60)]
    assert {body.limbs for body in bodies} == set(range(2, 13))
    assert {len(body.cuts) for body in bodies} == set(range(1, MOST_OPENINGS + 1))
    assert not drawn_body(np.random.default_rng(0), closed=True).cuts
    assert all((body.field(np.array(body.bounds), 1.0) > 0).all() for body in bodies)


@pytest.mark.parametrize("name", FLAWS)
def test_flaws_leave_the_area_of_the_surface_and_give_the_same_bytes_again(name, dome):
    def spoilt():
        return FLAWS[name](dome.vertices, dome.triangles, np.random.default_rng(1))

    points, faces = spoilt()
    assert all(np.array_equal(a, b) for a, b in zip((points, faces), spoilt(), strict=True))
    assert not np.array_equal(faces, dome.triangles)
    if name == "fins":
        assert len(trim_fins(points, faces)[0]) == len(dome.triangles)
        return
    area = TriMesh(points, drop_duplicates(faces)).area
    assert area == pytest.approx(dome.area, rel=0.02 if name == "size_jumps" else 1e-12)


def test_needles_are_thin_and_size_jumps_are_jumps(dome):
    needles = TriMesh(*FLAWS["needles"](dome.vertices, dome.triangles, np.random.default_rng(0)))
    assert needles.areas.min() < 0.05 * dome.areas.min()
    jumps = TriMesh(*FLAWS["size_jumps"](dome.vertices, dome.triangles, np.random.default_rng(0)))
    assert jumps.edge_lengths.max() > 3 * jumps.edge_lengths.min()
