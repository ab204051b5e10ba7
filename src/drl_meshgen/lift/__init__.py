"""Charts of regions and the way back to the surface."""
