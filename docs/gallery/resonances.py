"""Resonances of a driven Toda chain.

The springs soften at large amplitudes: resonances lean to lower frequencies, fold, and have
unstable orbits (dashed). As K. Geist and W. Lauterborn do (Physica D 31, 1988, 103-116), the
motions of the damped and driven chain are shown by their energy, here the mean one.
"""

import matplotlib.pyplot as plt
import numpy as np

from dynkit import continue_orbit
from dynkit.systems import SoftStop, TodaChain

plt.style.use("dynkit.plotting.journal")
far = SoftStop(0, offset=-100.0, stiffness=1.0)  # never met
figure, axes = plt.subplots()
for force, grey in ((0.15, "black"), (0.05, "0.6")):
    driven = {"frequency": 0.3, "harmonic_forces": [0.0, force]}
    chain = TodaChain(masses=2, damping=0.05, elements=[far], **driven)
    orbit = chain.attractor(transient=200).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.3, 2.0), largest_step=0.1)
    energy = []
    for i, frequency in enumerate(branch.parameter):
        x, v = branch.orbit(i).sample(np.linspace(0.0, 2.0 * np.pi / frequency, 64))
        e = np.diff(x, axis=1, prepend=0.0)  # of the springs
        energy.append((v**2 / 2 + np.exp(e) - 1 - e).sum(axis=1).mean())
    for kind, on in (("-", branch.stable), ("--", ~branch.stable)):
        name = f"force {force}" if kind == "-" else None
        axes.plot(branch.parameter, np.where(on, energy, np.nan), kind, color=grey, label=name)
axes.set(xlabel=r"frequency $\omega$", ylabel="mean energy", yscale="log")
axes.legend()
