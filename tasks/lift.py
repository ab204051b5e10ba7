"""Task that maps all nodes to the surface."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

lift = stage_task("lift", STAGES)
