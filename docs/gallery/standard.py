"""The standard map.

Sixty motions of a kicked rotor: closed curves, chains of islands, and chaos between them.
"""

import numpy as np

from dynkit.plotting.figures import new_figure
from dynkit.systems import StandardMap

rotor = StandardMap(k=0.95)
figure, (axes,) = new_figure(3.4, 3.2)
for start in np.random.default_rng(1).uniform(-np.pi, np.pi, (60, 2)):
    theta, p = rotor.attractor(start=start, transient=0, keep=1500).states.T
    axes.plot(theta % (2 * np.pi), (p + np.pi) % (2 * np.pi) - np.pi, ",", rasterized=True)
axes.set(xlabel=r"angle $\theta$", ylabel="momentum $p$")
