"""Programs that only developers run: they make the tables, masks and dark holes that the packages ship.

Nothing here is part of the distribution, and no package of it imports this one. Run them from the top of the
repository, for example ``python -m tools.dig_holes``.
"""
