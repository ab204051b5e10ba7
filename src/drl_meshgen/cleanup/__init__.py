"""From a triangle soup to one oriented manifold surface, with a record of every change."""

from drl_meshgen.cleanup.cleaning import CleanupOptions, CleanupResult, clean
from drl_meshgen.cleanup.repair import CleanupWarning

__all__ = ["CleanupOptions", "CleanupResult", "CleanupWarning", "clean"]
