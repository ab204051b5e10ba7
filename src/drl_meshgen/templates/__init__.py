"""Plane templates: O-type and C-type block structures of a polygon with given boundary nodes."""

from drl_meshgen.templates.c_type import CCounts, CParameters, CSides, instantiate_c
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.fill import FilledCap, FilledPatch, fill_cap, fill_transition, instantiated, unfolded
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.o_type import OParameters, instantiate
from drl_meshgen.templates.options import PlacementOptions
from drl_meshgen.templates.policy import Policy, RulePolicy, TemplatePolicy
from drl_meshgen.templates.untangle import Outcome

__all__ = [
    "CCounts",
    "CParameters",
    "CSides",
    "Domain",
    "FilledCap",
    "FilledPatch",
    "OParameters",
    "Outcome",
    "PlacementOptions",
    "Policy",
    "RulePolicy",
    "TemplateMesh",
    "TemplatePolicy",
    "fill_cap",
    "fill_transition",
    "instantiate",
    "instantiate_c",
    "instantiated",
    "unfolded",
]
