"""The effect ledger: what an observation models, what it leaves out, and how large that is predicted to be."""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
