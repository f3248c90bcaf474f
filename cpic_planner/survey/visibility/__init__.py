"""Visibility: when a star can be seen from the orbit of the telescope, and at which roll."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
