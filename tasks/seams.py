"""Task that opens handles and closed surfaces along seams."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

seams = stage_task("seams", STAGES)
