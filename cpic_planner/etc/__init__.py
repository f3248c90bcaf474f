"""Exposure-time calculator: rates, noise, settings and the three questions."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
