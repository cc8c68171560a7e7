"""Rotation numbers of closed curves.

At rate 2 the fixed point of the delayed logistic map loses its stability to a closed curve (NS).
The states turn by a sixth of the curve at each iterate, and less as the curve grows.
"""

import numpy as np

from dynkit import sweep
from dynkit.plotting.figures import new_figure
from dynkit.systems import DelayedLogistic

delayed, rates = DelayedLogistic(2.05), np.linspace(2.01, 2.16, 31)
found = sweep(delayed, "rate", rates, start=[0.5, 0.5], transient=3000, progress=False)
figure, (left, right) = new_figure(3.4, 4.6, rows=2)
for rate in (2.01, 2.06, 2.16):
    states = delayed.replace(rate=rate).attractor(start=[0.5, 0.5], keep=3000).states
    left.plot(*states.T, "k,", rasterized=True)
left.set(xlabel="$x$", ylabel="$y$", aspect="equal")
turns = np.array([label.rotation_number for label in found.labels], dtype=float)
right.plot(rates, turns, "ko-", ms=2, lw=0.6)
right.set(xlabel="rate", ylabel="rotation number")
