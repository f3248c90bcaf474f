"""Imaging: apodizer, point-spread functions, focal-plane mask, wavefront drift and their figures."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
