"""Subdomains filled in their charts and assembled into one block mesh."""

from drl_meshgen.assembly.assemble import Assembly, AssemblyOptions, assemble
from drl_meshgen.assembly.limits import LimitOptions, within
from drl_meshgen.assembly.subdomains import CapFill, RingFill, StripFill, SubdomainOptions, Subdomains, fill
from drl_meshgen.assembly.transition import TransitionFill

__all__ = [
    "Assembly",
    "AssemblyOptions",
    "CapFill",
    "LimitOptions",
    "RingFill",
    "StripFill",
    "SubdomainOptions",
    "Subdomains",
    "TransitionFill",
    "assemble",
    "fill",
    "within",
]
