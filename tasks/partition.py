"""Task that cuts the surface into caps, tubes and junctions."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

partition = stage_task("partition", STAGES)
