"""The report: tables, pictures and one page that shows them, for us and every rival."""

from drl_meshgen.report.build import build_report, slug
from drl_meshgen.report.collect import model_run
from drl_meshgen.report.inputs import OURS, ModelRun
from drl_meshgen.report.view import View, best_view

__all__ = ["OURS", "ModelRun", "View", "best_view", "build_report", "model_run", "slug"]
