"""Symmetries of what placement policies see and answer, as signed permutations, one row for each symmetry."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl import boundary, c_scene
from drl_meshgen.rl.scene import EXTRAS


@dataclass(frozen=True, eq=False)
class Symmetry:
    """What `g` names of the same domain do to the numbers that a policy sees, and how its answers return from there."""

    seen: Int[np.ndarray, "g s"]
    """Column that each number seen comes from."""
    seen_signs: Float[np.ndarray, "g s"]
    answered: Int[np.ndarray, "g a"]
    """Column that each answer comes from."""
    answered_signs: Float[np.ndarray, "g a"]


def of_square(answered: int) -> Symmetry:
    """Return the eight ways to name the corners of an O-type mesh, for so many `controls`."""
    count, kept = boundary.SAMPLES.shape
    extras = np.tile(np.arange(kept, kept + EXTRAS), (count, 1))
    return Symmetry(
        np.concatenate([boundary.SAMPLES, extras], axis=1),
        np.concatenate([boundary.SAMPLE_SIGNS, np.ones_like(extras)], axis=1),
        boundary.CONTROLS[:, :answered],
        boundary.CONTROL_SIGNS[:, :answered],
    )


def of_transition() -> Symmetry:
    """Return the two ways to name the parts of a C-type mesh: as it is, and mirrored."""
    return Symmetry(
        np.stack([np.arange(c_scene.SEEN), c_scene.SEEN_COLUMNS]),
        np.stack([np.ones(c_scene.SEEN), c_scene.SEEN_SIGNS]),
        np.stack([np.arange(c_scene.ANSWERED), c_scene.ANSWER_COLUMNS]),
        np.stack([np.ones(c_scene.ANSWERED), c_scene.ANSWER_SIGNS]),
    )
