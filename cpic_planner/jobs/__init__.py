"""Long work in an output folder: one loop for every kind of job, on one machine or on a cluster."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
