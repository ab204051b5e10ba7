"""Opening surfaces along seams, so that every component is of genus 0 and has a boundary."""

from drl_meshgen.seams.opened import OpenedSurface, Seam, SeamKind, open_surface
from drl_meshgen.seams.options import Outcome, SeamOptions

__all__ = ["OpenedSurface", "Outcome", "Seam", "SeamKind", "SeamOptions", "open_surface"]
