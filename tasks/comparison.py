"""Task that runs other meshers on the same surface."""

from drl_meshgen.pipeline import COMPARED_STAGES
from tasks.stage import stage_task

comparison = stage_task("comparison", COMPARED_STAGES)
