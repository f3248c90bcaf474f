"""The lowest layer: errors, outcomes, quantities, files, random streams; no physics."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
