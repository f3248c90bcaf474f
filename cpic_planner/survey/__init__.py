"""Survey what-ifs: visibility, strategies, schedules and Monte Carlo yields."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
