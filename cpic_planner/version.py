"""Version of the distribution that owns ``catalogs``, ``simulator`` and ``cpic_planner``."""

__version__ = "0.1.0"
DISTRIBUTION = "cpic-planner"
PACKAGES = ("catalogs", "simulator", "cpic_planner")
