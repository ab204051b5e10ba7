"""Task that welds the pieces into one block mesh."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

assembly = stage_task("assembly", STAGES)
