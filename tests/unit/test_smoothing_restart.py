import numpy as np
import pytest

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.smoothing import SmoothingOptions, optimise
from drl_meshgen.smoothing.nodes import NodeSpace
from drl_meshgen.smoothing.restart import averaged, settled
from drl_meshgen.smoothing.verdict import Referee


def grid(around, across):
    """Points and quads of a torus: `around` by `across` nodes."""
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    u, v = 2 * np.pi * i / around, 2 * np.pi * j / across
    points = np.stack([(1 + 0.4 * np.cos(v)) * np.cos(u), (1 + 0.4 * np.cos(v)) * np.sin(u), 0.4 * np.sin(v)], axis=-1)
    following, beside = (i + 1) % around, (j + 1) % across
    corners = (i * across + j, following * across + j, following * across + beside, i * across + beside)
    return points.reshape(-1, 3), np.stack(corners, axis=-1).reshape(-1, 4)


def lengths(mesh):
    tail, head = mesh.points[mesh.topology.edges.T]
    return np.linalg.norm(head - tail, axis=1)


@pytest.fixture(scope="module")
def torus():
    points, quads = grid(60, 24)
    surface = TriMesh(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    points, quads = grid(30, 12)
    _, triangle, points = TriangleSearch(surface.corners)(points)
    return surface, QuadMesh(points, quads), triangle


def noisy(surface, mesh, triangle, edges):
    """Nodes after random walks of so many edge lengths."""
    space, rng = NodeSpace(surface, mesh), np.random.default_rng(0)
    state, length = space.start(triangle), lengths(mesh).mean()
    for _ in range(4):
        state = space.moved(state, rng.normal(size=(len(mesh.points), 2)) * edges * length / 2)
    return QuadMesh(state.points, mesh.quads), state.triangle


def swapped(mesh, triangle, pairs):
    """Pairs of nodes, wherever they are, take each other's place."""
    ids = np.random.default_rng(0).permutation(len(mesh.points))[: 2 * pairs]
    order = np.arange(len(mesh.points))
    order[ids] = ids[::-1]
    return QuadMesh(mesh.points[order], mesh.quads), triangle[order]


def verdict(surface, mesh, points, triangle):
    moved = QuadMesh(points, mesh.quads)
    return Referee(surface, mesh, SmoothingOptions()).figures(NodeSpace(surface, moved).start(triangle), exact=True)


@pytest.mark.parametrize("damage", ["one edge of noise", "two edges of noise", "forty swaps"])
def test_closed_surface_is_valid_again_after_brutal_damage(torus, damage):
    surface, mesh, triangle = torus
    if damage == "forty swaps":
        broken, carried = swapped(mesh, triangle, 40)
    else:
        broken, carried = noisy(surface, mesh, triangle, 1 if damage.startswith("one") else 2)
    assert verdict(surface, mesh, broken.points, carried).invalid > 50
    result = optimise(surface, broken, carried)
    found = verdict(surface, mesh, result.points, result.triangle)
    assert found.invalid == 0
    assert found.min_angle > 70


def test_only_stray_nodes_are_settled(torus):
    surface, mesh, triangle = torus
    broken, carried = swapped(mesh, triangle, 3)
    space = NodeSpace(surface, broken)
    before = space.start(carried)
    after = settled(space, before)
    moved = np.nonzero((after.points != before.points).any(axis=1))[0]
    assert 0 < len(moved) <= 6
    assert np.linalg.norm(after.points - mesh.points, axis=1).max() < 1.5 * lengths(mesh).max()
    good = NodeSpace(surface, mesh)
    assert settled(good, start := good.start(triangle)) is start


def test_averaging_leaves_frozen_nodes_and_smooths_the_others(torus):
    surface, mesh, triangle = torus
    broken, carried = noisy(surface, mesh, triangle, 0.3)
    space = NodeSpace(surface, broken)
    state, moving = space.start(carried), np.arange(len(mesh.points)) % 4 != 0
    found = averaged(space, space.freeze(state, moving), 5)
    assert np.array_equal(found.points[~moving], state.points[~moving])
    edges = mesh.topology.edges

    def roughness(points):
        return (np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1) ** 2).sum()

    assert roughness(found.points) < roughness(state.points)
