"""Level-0 products: files, truth and parameters of a sequence, and their check."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
