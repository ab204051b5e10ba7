"""Zones for irregular nodes: what is forbidden is left, what is wanted is approached, and nothing else is promised."""

import numpy as np
import pytest

from drl_meshgen.commands.output import zone_table
from drl_meshgen.commands.settings import SettingsError, read_settings, to_toml
from drl_meshgen.decompose import Zone
from drl_meshgen.decompose.zones import attracted, held, misfit, repelled
from tests.chains import SURFACES, chain, run_on, surface_of

PLATE = "plate with holes"


def test_balls_and_boxes_contain_what_they_should():
    points = np.array([[0.0, 0, 0], [0.9, 0, 0], [0.9, 0.9, 0], [1.1, 0, 0]])
    assert Zone(radius=1.0).contains(points).tolist() == [True, True, False, False]
    assert Zone(half=(1.0, 1.0, 0.1)).contains(points).tolist() == [True, True, True, False]


@pytest.mark.parametrize("wrong", [{}, {"radius": -1.0}, {"half": (1.0, 2.0)}, {"half": (1.0, 0.0, 1.0)}])
def test_a_zone_without_extent_is_refused(wrong):
    with pytest.raises(ValueError, match=r"zone needs|three edge lengths"):
        Zone(**wrong)


def test_zones_come_back_from_settings(tmp_path):
    text = '[[decompose.zones]]\nkind = "wanted"\ncentre = [1, 2.5, 3]\nradius = 2\n'
    text += "[[decompose.zones]]\nhalf = [1.0, 2.0, 3.0]\n"
    (tmp_path / "a.toml").write_text(text, "utf-8")
    options = read_settings(tmp_path / "a.toml")
    assert options.decompose.zones == (Zone("wanted", (1.0, 2.5, 3.0), 2.0), Zone(half=(1.0, 2.0, 3.0)))
    assert options.by_stage("hand")["smoothing"].zones == options.decompose.zones
    (tmp_path / "b.toml").write_text(to_toml(options), "utf-8")
    assert read_settings(tmp_path / "b.toml") == options
    (tmp_path / "c.toml").write_text("decompose.zones = [{radius = 0.0}]\n", "utf-8")
    with pytest.raises(SettingsError, match="positive radius"):
        read_settings(tmp_path / "c.toml")


def test_three_loops_are_equally_near_at_a_wanted_point():
    rng = np.random.default_rng(0)
    points, distances = rng.normal(size=(50, 3)), rng.uniform(1, 2, (50, 4))
    scaled = attracted(distances, points, Zone("wanted", tuple(points[7].tolist()), 0.5))
    np.testing.assert_allclose(np.sort(scaled[7])[:3], np.sort(scaled[7])[0])
    assert attracted(distances, points, Zone("forbidden", tuple(points[7].tolist()), 0.5)) is None
    assert attracted(distances, points, Zone("wanted", (99.0, 0.0, 0.0), 0.5)) is None


def test_distances_shrink_only_in_forbidden_zones_and_keep_their_order_there():
    points = np.c_[np.linspace(0, 1, 101), np.zeros((101, 2))]
    distance = 1 + points[:, 0]
    zone = Zone("forbidden", (0.5, 0.0, 0.0), 0.2)
    found, inside = repelled(distance, points, (zone,)), zone.contains(points)
    np.testing.assert_array_equal(found[~inside], distance[~inside])
    assert (found[inside] < distance[inside]).all()
    assert (np.diff(found[inside]) > 0).all()


def spine_nodes(done):
    return np.concatenate([j.points[j.spine.nodes] for j in done["decompose"].pieces.junctions])


def meshed(*zones):
    return run_on(surface_of(PLATE), SURFACES[PLATE][1], zones=zones, strips=False)


def irregular(done):
    mesh = done["smoothing"].mesh.mesh
    return mesh.points[mesh.irregular]


@pytest.fixture(scope="module")
def plain():
    return meshed()


def test_irregular_nodes_leave_a_forbidden_zone_and_stay_as_many(plain):
    zone = Zone("forbidden", tuple(irregular(plain)[0].tolist()), 1.5)
    done = meshed(zone)
    assert zone.contains(irregular(plain)).any()
    assert not zone.contains(irregular(done)).any()
    assert len(irregular(done)) == len(irregular(plain))
    assert done["quality"].metrics["validity"] == 1
    table = zone_table((zone,), done["smoothing"].mesh.mesh)
    assert table["inside"].tolist() == [0]
    assert table["nearest"][0] > zone.radius


def test_an_irregular_node_comes_to_a_wanted_point_and_stays(plain):
    at = spine_nodes(plain)[0] + np.array([1.2, 0.6, 0.0])
    zone = Zone("wanted", tuple(at.tolist()), 4.0)
    done = meshed(zone)
    before, after = (zone.distances(irregular(one)).min() for one in (plain, done))
    assert after < before / 2
    assert after == pytest.approx(zone.distances(spine_nodes(done)).min(), abs=1e-6)


def test_zones_elsewhere_change_nothing(plain):
    done = meshed(Zone("forbidden", (500.0, 0.0, 0.0), 1.0), Zone("wanted", (-500.0, 0.0, 0.0), 1.0))
    np.testing.assert_array_equal(done["smoothing"].mesh.points, plain["smoothing"].mesh.points)


def test_nodes_near_zones_are_held_and_misfits_counted():
    nodes = np.array([[0.0, 0, 0], [1.5, 0, 0], [5, 0, 0]])
    forbidden, wanted = Zone("forbidden", (0.0, 0.0, 0.0), 1.0), Zone("wanted", (4.5, 0.0, 0.0), 1.0)
    assert held(nodes, (forbidden, wanted)).tolist() == [False, True, True]
    assert misfit(nodes, nodes, (forbidden, wanted)) == (1, 0.5)
    assert misfit(nodes, nodes[:2], (wanted,)) == (0, 0.0)


def test_caps_regard_no_zones():
    done = chain("two limbs")
    cap = done["decompose"].pieces.caps[0].mesh.vertices.mean(axis=0)
    zone = Zone("forbidden", tuple(cap.tolist()), 0.05)
    again = run_on(surface_of("two limbs"), SURFACES["two limbs"][1], ["decompose"], zones=(zone,))
    np.testing.assert_array_equal(again["decompose"].curve_counts, done["decompose"].curve_counts)
