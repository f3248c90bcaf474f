"""Closed forms of the light in an aperture, of its variance, and of what saturates, for all that predict them."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
