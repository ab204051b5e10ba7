"""Task that lays out blocks and node counts."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

decompose = stage_task("decompose", STAGES)
