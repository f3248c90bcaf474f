"""Settings of the whole suite."""

import os

# The matrices here are small: BLAS threads only get in each other's way, and sums should have one order.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
