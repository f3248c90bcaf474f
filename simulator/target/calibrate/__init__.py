"""How the table of the parametric albedo was made: ``python -m simulator.target.calibrate --help``.

Only maintainers need it; the package reads its result.
"""
