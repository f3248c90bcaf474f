"""Registries: scores of a ranking, libraries of reference frames and reductions by them, in one entry each."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
