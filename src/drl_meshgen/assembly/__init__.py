"""Subdomains filled in their charts and assembled into one block mesh."""

from drl_meshgen.assembly.assemble import Assembly, assemble
from drl_meshgen.assembly.subdomains import CapFill, RingFill, StripFill, Subdomains, fill
from drl_meshgen.assembly.transition import TransitionFill

__all__ = ["Assembly", "CapFill", "RingFill", "StripFill", "Subdomains", "TransitionFill", "assemble", "fill"]
