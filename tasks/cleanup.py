"""Task that makes one oriented manifold surface."""

from drl_meshgen.pipeline import STAGES
from tasks.stage import stage_task

cleanup = stage_task("cleanup", STAGES)
