"""A section of Henon and Heiles.

Stars of the energy 1/8, each in a colour of its own: closed curves around stable periodic orbits,
and chaos between them.
"""

import numpy as np

from dynkit import Hyperplane, PoincareMap
from dynkit.plotting.figures import new_figure
from dynkit.systems import HenonHeiles

axis = Hyperplane([1.0, 0.0, 0.0, 0.0], 0.0, 1)
returns = PoincareMap(HenonHeiles(), axis, time_limit=50.0, level=("energy", 0.125))
figure, (axes,) = new_figure(3.4, 3.2)
for y, v in [*((y, 0.0) for y in np.linspace(-0.35, 0.65, 17)), (0.0, 0.2), (0.0, 0.3)]:
    states = returns.attractor(start=[y, 0.4, v], transient=0, keep=500).states
    axes.plot(states[:, 0], states[:, 2], ".", ms=1.6, mew=0)
axes.set(xlabel="$y$", ylabel="$v$")
