"""Exposure times, rankings and plans for CPI-C, the coronagraph of the 2 m CSST space telescope.

Everything public of ``simulator`` is also reachable from here. Names load on first use; importing the package
loads no heavy library.

Examples
--------
>>> import cpic_planner
>>> cpic_planner.lambert_phase(0.0)
1.0
"""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
