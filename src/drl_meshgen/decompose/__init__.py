"""Decomposition of regions into rings and caps with node counts."""

from drl_meshgen.decompose.described import Description, describe
from drl_meshgen.decompose.pieces import Cap, Junction, Pieces, Tube
from drl_meshgen.decompose.stage import DecomposeOptions, Layout, decompose
from drl_meshgen.decompose.zones import Zone

__all__ = [
    "Cap",
    "DecomposeOptions",
    "Description",
    "Junction",
    "Layout",
    "Pieces",
    "Tube",
    "Zone",
    "decompose",
    "describe",
]
