"""Observations: from a scene through optics and camera to single frames, sums of frames and calibrations."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
