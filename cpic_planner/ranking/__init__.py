"""Ranking: settings of every star, completeness, order, and how firm the order is."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
