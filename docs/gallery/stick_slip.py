"""Stick and slip on a belt.

A block on a moving belt, held by a spring. It moves with the belt until the spring overcomes the
static force, slips back, and sticks again. The cycle is solved for; motions outside it lead to
it.
"""

import numpy as np

from dynkit.plotting.figures import new_figure
from dynkit.systems import DryFriction, ImpactChain

belt = DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt")
block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[belt])
figure, (axes,) = new_figure()
for start, shade in (([-0.4], "0.7"), ([1.2], "0.5")):
    record = block.simulate(impacts=4, start=block.state(start, [0.0]))
    x, v = record.sample(np.linspace(0.0, record.time[-1], 4000))
    axes.plot(x, v, color=shade, lw=0.7)
cycle = block.periodic_orbit(start=block.state([0.0], [0.2]))
x, v = cycle.sample(np.linspace(0.0, cycle.period, 1000))
axes.plot(x, v, "k", lw=1.2)
axes.set(xlabel="displacement $x$", ylabel="velocity $v$")
