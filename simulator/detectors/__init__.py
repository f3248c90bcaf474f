"""Effects of the detectors: each one class in one file, and the two cameras as chains of them."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
