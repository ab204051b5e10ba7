"""Filling one simply connected domain by a template, with a verdict."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drl_meshgen.templates.c_type import CCounts, CParameters, CSides, instantiate_c
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.o_type import OParameters, instantiate
from drl_meshgen.templates.options import Size
from drl_meshgen.templates.policy import Policy, RulePolicy, TemplatePolicy, boundary_size
from drl_meshgen.templates.untangle import Outcome, untangle


@dataclass(frozen=True, eq=False)
class FilledCap(TemplateMesh):
    """An O-type mesh with the parameters it was made from and the verdict on its cells."""

    parameters: OParameters
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class FilledPatch(TemplateMesh):
    """A C-type mesh with the parameters it was made from and the verdict on its cells."""

    parameters: CParameters
    outcome: Outcome


def fill_cap(
    boundary: Float[np.ndarray, "l 2"],
    policy: Policy | None = None,
    k: int | None = None,
    size: Size | None = None,
    corners: tuple[int, int] | None = None,
) -> FilledCap:
    """Return an O-type mesh of the polygon `boundary`, whose nodes are its first L points unchanged.

    `policy` chooses the parameters (`RulePolicy()` if None), `k` fixes the number of layers, `corners` the first
    corner and the cells to the second, `(i0, m)`, `size(points)` is the
    wanted edge length at points of the plane (for the disk image of a surface: length on the surface divided by the
    local stretch); if None the boundary spacing is continued inwards. Folded cells are unfolded by moving interior
    nodes; `outcome` tells. Raises `InputError` for a boundary that is not simple and anti-clockwise with an even
    number of at least 8 nodes.
    """
    domain = Domain(boundary)
    parameters = (policy or RulePolicy()).choose(domain, layers=k, size=size, corners=corners)
    mesh, outcome = unfolded(domain, parameters, size)
    return FilledCap(mesh.points, mesh.grids, parameters, outcome)


def fill_transition(
    boundary: Float[np.ndarray, "l 2"],
    start: int,
    cells: CSides | CCounts,
    policy: TemplatePolicy | None = None,
    size: Size | None = None,
) -> FilledPatch:
    """Return a C-type mesh of the polygon `boundary` whose node `start` is the bottom left corner.

    Bottom, right, top and left side follow anti-clockwise with so many `cells`, or with those of all counts where these
    are given; `policy` chooses the rest. See `fill_cap` for what else there is to say.
    """
    domain = Domain(boundary)
    parameters = (policy or RulePolicy()).transition(domain, start, cells)
    mesh, outcome = unfolded(domain, parameters, size)
    return FilledPatch(mesh.points, mesh.grids, parameters, outcome)


def instantiated(domain: Domain, parameters: OParameters | CParameters) -> TemplateMesh:
    """Return the mesh of a domain by parameters of either type."""
    if isinstance(parameters, OParameters):
        return instantiate(domain, parameters)
    return instantiate_c(domain, parameters)


def unfolded(
    domain: Domain, parameters: OParameters | CParameters, size: Size | None = None
) -> tuple[TemplateMesh, Outcome]:
    """Return the mesh by parameters of either type, folded cells unfolded as in `fill_cap`, and the verdict."""
    mesh = instantiated(domain, parameters)
    return untangle(mesh, len(domain), (size or boundary_size(domain))(mesh.points))
