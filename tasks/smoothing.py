"""Task that optimises node positions on the surface."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

smoothing = stage_task("smoothing", STAGES)
