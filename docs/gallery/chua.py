"""Chua's double scroll.

A circuit with a nonlinear resistor, followed by Taylor's method, and its three equilibria (red),
all of them unstable.
"""

import numpy as np

from dynkit import equilibrium
from dynkit.plotting.figures import new_figure
from dynkit.systems import Chua

circuit = Chua()
path = [np.array([0.1, 0.1, 0.0])]
for _ in range(8000):
    path.append(circuit.advance(path[-1], 0.02))
rests = [equilibrium(circuit, [x, 0.0, -x]).state for x in (-1.6, 0.0, 1.6)]
figure, (axes,) = new_figure()
axes.plot(*np.array(path)[500:, :2].T, "k", lw=0.4)
axes.plot(*np.array(rests)[:, :2].T, "o", color="tab:red", ms=3)
axes.set(xlabel="$x$", ylabel="$y$")
