"""Planets: orbits, laws of occurrence, populations, and draws of what is known of a planet."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
