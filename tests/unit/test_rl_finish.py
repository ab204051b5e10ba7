from dataclasses import replace

import numpy as np
import pytest

from drl_meshgen.quality.metrics import line_smoothness as measured_smoothness
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl import finish_kernel as kernel
from drl_meshgen.rl.finish import FinishOptions, _Problem, finished
from drl_meshgen.rl.policies import policy_named
from drl_meshgen.templates import CSides, RulePolicy, TemplateMesh, fill_transition, instantiate
from drl_meshgen.templates.score import jacobian_ratio, jacobians, orthogonality, validity_penalty

AGENT = policy_named("agent")
FEW = FinishOptions(iterations=12)


def o_mesh(data=DataSet.VALIDATION, index=0, policy=AGENT, layers=None):
    domain = next(iter(samples_of(data, [index]))).domain
    return instantiate(domain, policy.choose(domain, layers=layers)), len(domain)


def c_mesh():
    side = [np.linspace(a, b, n + 1)[:-1] for a, b, n in (
        ((0, 0), (4, 0), 14), ((4, 0), (3.4, 2), 6), ((3.4, 2), (0.5, 2.3), 8), ((0.5, 2.3), (0, 0), 6))]  # fmt: skip
    nodes = np.concatenate(side)
    return fill_transition(nodes, 0, CSides(14, 6, 8)), len(nodes)


def worth(mesh, o):
    points, quads = mesh.points, mesh.quads
    shape = o.angle * orthogonality(points, quads) + o.ratio * jacobian_ratio(points, quads)
    return shape.mean() - validity_penalty(points, quads) + o.smoothness * measured_smoothness(mesh.blocks.mesh)[0]


MESHES = {
    "a domain": o_mesh,
    "a hard domain": lambda: o_mesh(DataSet.VALIDATION_HARD, 1),
    "many layers": lambda: o_mesh(layers=6),
    "a mesh of the rule": lambda: o_mesh(policy=RulePolicy()),
    "a C-type mesh": c_mesh,
}


@pytest.mark.parametrize("made", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("options", [FEW, FinishOptions(iterations=6, smoothness=5.0)], ids=["default", "smooth"])
def test_finishing_raises_the_objective_and_keeps_boundary_validity_and_topology(made, options):
    mesh, fixed = made()
    assert mesh.valid
    result = finished(mesh, fixed, options)
    assert worth(result, options) > worth(mesh, options) + 1e-3
    assert result.valid
    assert result.points[:fixed].tobytes() == mesh.points[:fixed].tobytes()
    assert all(np.array_equal(a, b) for a, b in zip(result.grids, mesh.grids, strict=True))


def test_no_quad_comes_closer_to_folding_than_the_bound_or_than_the_worst_was():
    mesh, fixed = o_mesh(DataSet.VALIDATION_HARD, 1)
    for least in (0.3, 0.6):
        options = replace(FEW, least=least)
        before, after = (
            (
                jacobians(m.points, m.quads)
                / (np.linalg.norm(np.roll(m.points[m.quads], -1, 1) - m.points[m.quads], axis=-1).mean(-1) ** 2)[
                    :, None
                ]
            ).min()
            for m in (mesh, finished(mesh, fixed, options))
        )
        assert after >= min(least, before) - 1e-12


@pytest.mark.parametrize("made", [o_mesh, c_mesh])
def test_turned_shifted_and_scaled_meshes_are_finished_alike(made):
    mesh, fixed = made()
    turn = 37.0 * np.array([[np.cos(1.1), np.sin(1.1)], [-np.sin(1.1), np.cos(1.1)]])
    shift = np.array([5.0, -3.0])
    moved = TemplateMesh(mesh.points @ turn + shift, mesh.grids)
    there = finished(moved, fixed, FEW).points
    assert there == pytest.approx(finished(mesh, fixed, FEW).points @ turn + shift, abs=37.0 * 1e-6)


def test_the_same_mesh_is_finished_to_the_same_bits():
    mesh, fixed = o_mesh()
    assert finished(mesh, fixed, FEW).points.tobytes() == finished(mesh, fixed, FEW).points.tobytes()


def test_a_folded_mesh_gets_no_worse():
    mesh, fixed = o_mesh()
    points = mesh.points.copy()
    points[-1] += 0.2
    folded = TemplateMesh(points, mesh.grids)
    assert not folded.valid
    assert worth(finished(folded, fixed, FEW), FEW) > worth(folded, FEW)


def test_nothing_moves_without_steps_or_interior_nodes():
    mesh, fixed = o_mesh()
    assert finished(mesh, fixed, FinishOptions(iterations=0)) is mesh
    square = TemplateMesh(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), (np.array([[0, 3], [1, 2]]),))
    assert finished(square, 4) is square


def test_a_mesh_that_is_as_good_as_can_be_stays():
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    rim = (x % 3 == 0) | (y % 3 == 0)
    order = np.concatenate([np.nonzero(rim.ravel())[0], np.nonzero(~rim.ravel())[0]])
    points = np.c_[x.ravel(), y.ravel()][order]
    mesh = TemplateMesh(points, (np.argsort(order).reshape(4, 4),))
    assert finished(mesh, int(rim.sum())).points == pytest.approx(points, abs=1e-12)


def test_finishing_keeps_what_a_filled_domain_says_about_itself():
    mesh, fixed = c_mesh()
    result = finished(mesh, fixed, FEW)
    assert result.outcome is mesh.outcome
    assert result.parameters is mesh.parameters


def test_gradients_are_differences_of_values():
    mesh, fixed = o_mesh(DataSet.VALIDATION_HARD, 1)
    problem = _Problem.of(mesh, fixed, FinishOptions(sharpness=3))
    rng = np.random.default_rng(0)
    inner = mesh.points[fixed:]
    slope = problem(inner)[1]
    for _ in range(4):
        way = rng.normal(size=inner.shape)
        ahead, back = (problem(inner + h * way)[0] for h in (1e-7, -1e-7))
        assert (ahead - back) / 2e-7 == pytest.approx((slope * way).sum(), rel=1e-4, abs=1e-7)


def test_stand_ins_approach_the_figures_as_they_sharpen():
    mesh, fixed = o_mesh()
    points, quads = mesh.points, np.array(mesh.quads)
    exact = (orthogonality(points, quads) + jacobian_ratio(points, quads)).mean() - validity_penalty(points, quads)
    gaps = [
        abs(kernel.quads_worth(points, quads, (1.0, 1.0), sharpness, np.zeros_like(points))[0] - exact)
        for sharpness in (3, 5, 7, 9)
    ]
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[-1] < 3e-3
    smooth = kernel.line_smoothness(points, _Problem.of(mesh, fixed, FEW).lines, 0.0, 0.0, np.zeros_like(points))
    assert smooth == pytest.approx(measured_smoothness(mesh.blocks.mesh)[0], abs=1e-12)
