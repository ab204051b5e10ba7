"""Partition of the surface into caps, tubes and junctions by isocontours of the depth."""

from drl_meshgen.partition.cutting import CutSurface
from drl_meshgen.partition.levels import PartitionOptions
from drl_meshgen.partition.stage import Curve, Outcome, Partition, Region, RegionKind, partition

__all__ = ["Curve", "CutSurface", "Outcome", "Partition", "PartitionOptions", "Region", "RegionKind", "partition"]
