"""Task that finds the flat metric."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

ricci = stage_task("ricci", STAGES)
