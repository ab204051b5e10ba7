"""Other meshers on the same surface, as rivals: what they made, or why they made nothing."""

from drl_meshgen.baselines.compare import Comparison, compare
from drl_meshgen.baselines.runner import Method, Rival, RivalOptions, RivalOutcome, run_rival

__all__ = ["Comparison", "Method", "Rival", "RivalOptions", "RivalOutcome", "compare", "run_rival"]
