"""Level-0 data of many sequences: what is asked for, what it costs, and the run that can be continued."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
