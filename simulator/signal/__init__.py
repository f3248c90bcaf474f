"""Closed forms of the light in an aperture, of its variance, and of what saturates, for all that predict them."""
