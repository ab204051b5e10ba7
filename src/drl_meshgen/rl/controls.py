"""The continuous parameters of an O-type mesh as one vector, in the frame of its domain."""

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from drl_meshgen.templates.curves import SWELLS, WAVES
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import EDGES, OParameters

PLAIN: Final = 8 + 2 * EDGES
"""Continuous parameters of the paper's template: four points, eight pairs of amplitudes."""
SHAPED: Final = PLAIN + 2 * (WAVES * EDGES + 4 * SWELLS)
"""The same with waves and swells."""
FREED: Final = SHAPED + 2 * 4 * SWELLS
"""The same with boundary nodes that may leave their samples, as sines along each side say; for ablations only."""


def parts_of(x: Any) -> dict[str, Any]:
    """Return continuous parameters (..., `PLAIN`, `SHAPED` or `FREED`) as fields of `OParameters`, and `rim`.

    An array gives arrays, a tensor gives tensors.
    """
    lead = x.shape[:-1]
    parts = {"singular": x[..., :8].reshape(*lead, 4, 2), "bulges": x[..., 8:PLAIN].reshape(*lead, EDGES, 2)}
    if x.shape[-1] >= SHAPED:
        ends = PLAIN + 2 * WAVES * EDGES
        parts["waves"] = x[..., PLAIN:ends].reshape(*lead, EDGES, WAVES, 2)
        parts["swells"] = x[..., ends:SHAPED].reshape(*lead, 4, SWELLS, 2)
    if x.shape[-1] == FREED:
        parts["rim"] = x[..., SHAPED:].reshape(*lead, 4, SWELLS, 2)
    return parts


def parameters_of(domain: Domain, corners: tuple[int, int], layers: int, x: Float[np.ndarray, " c"]) -> OParameters:
    """Return the parameters of a domain from continuous ones in its frame."""
    parts, (i0, m), frame = parts_of(x), corners, domain.frame
    moved = {name: parts[name] * frame.scale for name in ("waves", "swells") if name in parts}
    singular = frame.to_world(parts["singular"])
    return OParameters(i0, m, len(domain) // 2 - m, layers, singular, parts["bulges"], **moved)
