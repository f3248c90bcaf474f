"""Facts: stars, names, bands, spectra, albedos and sky, with their sources.

Part of the distribution ``cpic-planner``. Names load on first use.
"""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
