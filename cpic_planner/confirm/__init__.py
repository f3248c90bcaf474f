"""Confirmation: targets and scenes observed in simulated images, measured blind and held against the predictions."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
