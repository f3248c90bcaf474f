"""Speed against accuracy, measured on fixed scenes: time, memory and error of every way to an answer."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
