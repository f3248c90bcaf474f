"""Version of the distribution that owns ``catalogs``, ``simulator`` and ``cpic_planner``."""

__version__ = "0.2.0"
DISTRIBUTION = "cpic-planner"
PACKAGES = ("catalogs", "simulator", "cpic_planner")
