"""The rule-based fill commutes with every symmetry of the plane and of the numbering."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.templates import fill_cap

COUNT = 20


def wobbly(seed, count=COUNT):
    rng = np.random.default_rng(seed)
    step = np.exp(rng.normal(0, 0.25, count))
    angle = 2 * np.pi * np.cumsum(step) / step.sum()
    radius = 1 + 0.1 * np.cos(2 * angle + rng.uniform(0, 6)) + 0.08 * np.cos(3 * angle + rng.uniform(0, 6))
    return np.c_[radius * np.cos(angle), radius * np.sin(angle)]


def same_nodes(mesh, points):
    gap = np.abs(mesh.points[:, None] - points[None]).max(axis=-1)
    return len(mesh.points) == len(points) and gap.min(axis=1).max() < 1e-5 and gap.min(axis=0).max() < 1e-5


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(0, 50), st.floats(0, 6), st.floats(1e-3, 1e3), st.floats(-5, 5))
def test_a_similarity_of_the_boundary_is_one_of_the_mesh(seed, angle, scale, shift):
    turn = scale * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    boundary = wobbly(seed)
    mesh = fill_cap(boundary)
    moved = fill_cap(boundary @ turn + shift)
    assert moved.parameters.i0 == mesh.parameters.i0
    assert (moved.points - shift) / scale == pytest.approx((mesh.points @ turn) / scale, abs=1e-5)


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(0, 50), st.integers(1, COUNT - 1))
def test_renumbering_the_boundary_gives_the_same_nodes(seed, shift):
    boundary = wobbly(seed)
    assert same_nodes(fill_cap(np.roll(boundary, shift, axis=0)), fill_cap(boundary).points)


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(0, 50))
def test_mirroring_the_boundary_mirrors_the_nodes(seed):
    boundary = wobbly(seed)
    mirrored = boundary[::-1] * [-1, 1]
    assert same_nodes(fill_cap(mirrored), fill_cap(boundary).points * [-1, 1])


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.integers(4, 30))
def test_uneven_and_mildly_non_convex_boundaries_give_valid_meshes(seed, half):
    mesh = fill_cap(wobbly(seed, 2 * half))
    assert mesh.valid, mesh.outcome.value


def test_the_same_input_gives_the_same_bits():
    boundary = wobbly(3)
    assert fill_cap(boundary).points.tobytes() == fill_cap(boundary).points.tobytes()
