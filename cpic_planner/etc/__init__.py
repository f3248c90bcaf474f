"""Exposure-time calculator: rates, noise, settings and the three questions."""
