"""Command line."""

import gc

# Nearly all that a command loads lives until it ends: looking through it again and again frees nothing.
gc.set_threshold(200_000, 20, 20)
