"""Fully automatic block-structured quad meshing of triangulated surfaces."""

__version__ = "0.1.0"
