"""Effects of the detectors: each one class in one file, and the two cameras as chains of them."""
