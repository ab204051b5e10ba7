"""Task that places the nodes of every piece in its chart."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

subdomain = stage_task("subdomain", STAGES)
