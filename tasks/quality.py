"""Task that measures the finished mesh."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

quality = stage_task("quality", STAGES)
