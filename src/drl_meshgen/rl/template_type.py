"""Which template fills a plane domain, O-type or C-type; the paper leaves this to others (its reference 45)."""

from enum import StrEnum
from itertools import combinations
from typing import Final

import numpy as np
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.rl.transitions import LEAST
from drl_meshgen.templates.c_type import CParameters, CSides
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.fill import instantiated
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.o_type import OParameters
from drl_meshgen.templates.policy import TemplatePolicy
from drl_meshgen.templates.score import least_jacobian, reward

SHARP: Final = np.radians(30)
"""Least turn of the boundary at a node that may be a corner."""
MOST_SHARP: Final = 12
"""Corners that are looked at, the sharpest."""
TRIED: Final = 4
"""Ways to take the domain for a four-sided one that get a mesh."""


def turns(nodes: Float[np.ndarray, "l 2"]) -> Float[np.ndarray, " l"]:
    """Return by how much the boundary turns to the left at each node, in radians."""
    z = nodes[:, 0] + 1j * nodes[:, 1]
    return np.angle((np.roll(z, -1) - z) / (z - np.roll(z, 1)))


def four_sides(domain: Domain) -> list[tuple[int, CSides]]:
    """Return the ways to take a domain for one that C-type templates fill: bottom left corner and cells of the sides.

    Its corners are sharp; the ways with the sharpest come first. Where as many cells lie left as right depends on the
    nodes, so most domains have no such way.
    """
    turn = turns(domain.nodes)
    sharp = [int(i) for i in np.argsort(-turn, kind="stable")[:MOST_SHARP] if turn[i] > SHARP]
    found = []
    for four in combinations(sorted(sharp), 4):
        cells = np.diff([*four, four[0] + len(domain)]).tolist()
        for i in range(4):
            bottom, right, top, left = cells[i:] + cells[:i]
            if right == left >= 2 and top >= 3 and bottom > top and (bottom - top) % 2 == 0:
                found.append((-float(turn[list(four)].sum()), four[i], CSides(bottom, right, top)))
    return [(start, sides) for _, start, sides in sorted(found)[:TRIED]]


class Template(StrEnum):
    """What a domain is filled by."""

    AUTO = "auto"
    """The type whose mesh is worth more, valid ones first."""
    O_TYPE = "o"
    C_TYPE = "c"


def template_for(
    policy: TemplatePolicy, domain: Domain, template: Template = Template.AUTO, layers: int | None = None
) -> OParameters | CParameters:
    """Return what a policy chooses for a domain; `layers` are those of an O-type mesh.

    Of both types that of higher reward is taken, the worst corner counting as in the choice of counts. Raises
    `InputError` for an odd number of nodes, and for a domain without the four corners that C-type needs.
    """
    ways = [] if template is Template.O_TYPE else four_sides(domain)
    if template is Template.C_TYPE and not ways:
        what = "has no four corners with as many cells left as right and an even number more below than above"
        raise InputError("C-type template", what, "set other points, or take the O-type template")
    found: list[OParameters | CParameters] = [policy.transition(domain, start, sides) for start, sides in ways]
    if template is not Template.C_TYPE:
        found.append(policy.choose(domain, layers=layers))
    return max(found, key=lambda one: _worth(instantiated(domain, one)))


def _worth(mesh: TemplateMesh) -> tuple[bool, float]:
    """Return whether a mesh is valid, and its reward, the worst corner counting as well."""
    points, quads = np.array(mesh.points), np.array(mesh.quads)
    return mesh.valid, float(reward(points, quads) + LEAST * least_jacobian(points, quads).min())
