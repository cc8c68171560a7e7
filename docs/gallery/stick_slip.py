"""Stick and slip on a belt.

A block on a moving belt, held by a spring. It moves with the belt until the spring overcomes the
static force, slips back, and sticks again. The cycle (bold) is solved for. Two motions outside it
(dotted, dashed) lead to it.
"""

import matplotlib.pyplot as plt
import numpy as np

from dynkit.systems import DryFriction, ImpactChain

belt = DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt")
block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[belt])
plt.style.use("dynkit.plotting.journal")
figure, axes = plt.subplots()
for start, look in (([-0.4], ":"), ([1.2], "--")):
    record = block.simulate(impacts=4, start=block.state(start, [0.0]))
    x, v = record.sample(np.linspace(0.0, record.time[-1], 4000))
    axes.plot(x, v, f"k{look}", lw=0.7)
cycle = block.periodic_orbit(start=block.state([0.0], [0.2]))
x, v = cycle.sample(np.linspace(0.0, cycle.period, 1000))
axes.plot(x, v, "k", lw=1.2)
axes.text(0.5, 0.17, "stick", ha="center", va="top")
axes.text(0.5, -0.33, "slip", ha="center")
axes.set(xlabel="displacement $x$", ylabel="velocity $v$")
