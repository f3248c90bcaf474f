"""Registries: what a ranking can be by, and where reference frames can come from, in one entry each."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
