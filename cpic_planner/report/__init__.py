"""Reports: tables, figures, the HTML page and terminal tables."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
