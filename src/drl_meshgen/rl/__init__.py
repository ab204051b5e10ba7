"""Template-prior-guided reinforcement learning (paper sections 5 and 6): domains, reward, learners, policies."""

from drl_meshgen.rl.datasets import DataSet, Sample, read_samples, samples_of, write_samples
from drl_meshgen.rl.domains import FAMILIES, Difficulty, drawn_domain

__all__ = [
    "FAMILIES",
    "DataSet",
    "Difficulty",
    "Sample",
    "drawn_domain",
    "read_samples",
    "samples_of",
    "write_samples",
]
