"""Survey what-ifs: visibility, strategies, schedules and Monte Carlo yields."""
