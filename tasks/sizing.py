"""Task that finds how large quads should be where."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

sizing = stage_task("sizing", STAGES)
