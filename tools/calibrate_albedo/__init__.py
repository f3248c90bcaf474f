"""Make the table of the parametric albedo: ``python -m tools.calibrate_albedo --help``.

Only maintainers need it; the package reads its result.
"""
