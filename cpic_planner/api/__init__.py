"""The public functions of the planner, by star names and plain numbers; `cpic_planner` has them all."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
