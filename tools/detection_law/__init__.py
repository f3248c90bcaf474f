"""The law of detection, measured on stacks of visits: ``python -m tools.detection_law``.

Only maintainers need it; the package reads the numbers that its report fits from the preset strategy ``default``.
"""
