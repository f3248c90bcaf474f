"""Validation: reduction of images and photometry of planets, as blind as an observer's."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
