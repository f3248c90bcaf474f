"""How the table of the parametric albedo was made: ``python -m tools.calibrate_albedo --help``.

Only maintainers need it; the package reads its result.
"""
