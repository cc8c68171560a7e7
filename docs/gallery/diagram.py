"""A bifurcation diagram and a branch.

The chain of ten masses above its table. Dots are impacts of attractors. The line is the orbit
P(1,3): solid where it is stable, dotted where it is no motion of the chain.
"""

import numpy as np

from dynkit import continue_orbit, sweep
from dynkit.plotting.figures import new_figure
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=0.87)
orbit = chain.periodic_orbit(impacts=1, periods=3)
branch = continue_orbit(orbit, "frequency", bounds=(0.74, 1.02))
found = sweep(chain, "frequency", np.arange(0.74, 1.02, 0.001), progress=False)
figure, (axes,) = new_figure(6.8, 2.8)
found.plot(axes)
branch.plot(axes, y="relative_velocity")
axes.set(xlim=(0.74, 1.02), ylim=(0, None))
