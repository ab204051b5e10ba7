import numpy as np
import pytest
import torch

from drl_meshgen.rl.c_domains import TEST, drawn_counts, four_sided
from drl_meshgen.rl.c_scene import (
    ANSWER_COLUMNS,
    ANSWER_SIGNS,
    ANSWERED,
    PER_PART,
    SEEN_COLUMNS,
    SEEN_SIGNS,
    CScene,
    counts_of,
    part_samples,
    reference,
)
from drl_meshgen.rl.c_surrogate import CSurrogate
from drl_meshgen.templates import CCounts, CParameters, Domain, instantiate_c


def scene_of(domain, start, counts):
    rim = part_samples(domain.nodes[None], np.array([start]), counts.rim[None], PER_PART)
    return CScene.of(rim, counts_of([counts]))


@pytest.mark.parametrize("index", [2, 5, 8, 19])
def test_the_mirrored_domain_is_seen_and_answered_as_the_signed_permutations_say(index):
    one = next(four_sided(TEST[0], [index]))
    c = drawn_counts(np.random.default_rng(0), one.sides)
    other = CCounts(c.q1, c.p, c.n, c.q0, c.below, c.above)
    flipped = Domain(np.roll((one.domain.nodes * [-1, 1])[::-1], c.sides.bottom + 1, axis=0))
    here, there = scene_of(one.domain, 0, c), scene_of(flipped, 0, other)
    assert there.seen == pytest.approx(here.seen[:, SEEN_COLUMNS] * SEEN_SIGNS, abs=1e-12)
    x = np.random.default_rng(1).normal(0, 0.1, (1, ANSWERED))
    answers = here.placed(x), there.placed(x[:, ANSWER_COLUMNS] * ANSWER_SIGNS)
    first, second = (
        instantiate_c(d, CParameters(0, k, **{name: part[0] for name, part in parts.items()}))
        for d, k, parts in zip((one.domain, flipped), (c, other), answers, strict=True)
    )
    gaps = [np.linalg.norm(first.points - p * [-1, 1], axis=1).min() for p in second.points]
    assert max(gaps) < 1e-12


def test_the_coarse_mesh_is_the_template_itself_where_cells_agree():
    counts, t = CCounts(4, 4, 4, 4, 4, 4), np.arange(20) / 20
    up = np.arange(8) / 8
    sides = [np.c_[t, 0 * t], np.c_[1 + 0 * up, up]]
    top = np.arange(12) / 12
    domain = Domain(np.concatenate([*sides, np.c_[1 - top, 1 + 0 * top], np.c_[0 * up, 1 - up]]))
    rim = part_samples(domain.nodes[None], np.array([0]), counts.rim[None], 4)
    singular = reference(rim, counts_of([counts]))
    bulges = np.random.default_rng(0).normal(0, 0.05, (1, 12, 2))
    coarse = CSurrogate(4)
    points = coarse.points(*map(torch.as_tensor, (rim, singular, bulges))).numpy()[0]
    mesh = instantiate_c(domain, CParameters(0, counts, singular[0], bulges[0]))
    assert points == pytest.approx(np.array(mesh.points), abs=1e-12)
    assert coarse.share(torch.as_tensor(counts_of([counts]))).sum().item() == pytest.approx(1)
