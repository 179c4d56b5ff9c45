"""The daemon on each robot: serial ports, clock, motor guard, terminal. Decides nothing about the fleet."""

import os

# One thread: a 12-row matrix gains nothing from more, and sums in another order would not replay bit for bit.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
