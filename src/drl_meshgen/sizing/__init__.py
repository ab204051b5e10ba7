"""How large quads should be where: curvature, the user's wishes, and a limit to how fast sizes change."""

from drl_meshgen.sizing.curvature import largest_curvature
from drl_meshgen.sizing.field import SizeField, SizeOptions, Sizes, size_field

__all__ = ["SizeField", "SizeOptions", "Sizes", "largest_curvature", "size_field"]
