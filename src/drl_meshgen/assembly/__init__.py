"""Assembly of filled pieces into one block mesh."""

from drl_meshgen.assembly.assemble import assemble

__all__ = ["assemble"]
