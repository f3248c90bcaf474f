"""Reduction of Level-0 frames to Level 1: electrons of light with their error and mask."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
