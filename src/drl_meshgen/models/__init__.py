"""Surfaces to mesh: generated models by name, user files by path."""

from drl_meshgen.models.loading import MODELS, existing_file, is_generated, load
from drl_meshgen.models.surface import RawSurface

__all__ = ["MODELS", "RawSurface", "existing_file", "is_generated", "load"]
