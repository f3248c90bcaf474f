"""Typed results that leave the program: their JSON is described by the schemas that ``cpic schema`` prints.

`PlanResult` holds what is reproducible (no clock, no path, no host); `RunRecord` holds the story of the run.
"""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
