"""Task that builds a generated model or reads a file."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

model = stage_task("model", STAGES)
