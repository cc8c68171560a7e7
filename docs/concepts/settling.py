"""How a motion settles: its distance from the orbit, and the largest multiplier."""

import numpy as np

from dynkit.plotting.figures import new_figure, print_style
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=0.87)
orbit = chain.periodic_orbit(impacts=1, periods=3)
states = chain.attractor(transient=0, impacts=500).states
distances = [np.abs(chain.difference(state, orbit.states[0])).max() for state in states]
figure, (axes,) = new_figure(4.4, 2.6)
axes.semilogy(distances, "k.", ms=1.5, label="distance from the orbit")
slope = abs(orbit.multipliers[0]) ** np.arange(400)
axes.semilogy(0.3 * slope, "0.6", lw=0.8, label=r"$|\mu|^n$, $\mu$ the largest multiplier")
axes.set(xlabel="impacts $n$", ylabel="distance", ylim=(1e-17, 1e3))
with print_style():
    axes.legend(loc="upper right")
