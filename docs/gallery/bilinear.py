"""The resonance of a bilinear oscillator.

The spring is four times as stiff where the mass presses against a soft stop. At the two grazings
(GR) the mass only just reaches the stop; outside them the oscillator is linear. Inadmissible
orbits are the linear motion through the stop, which is not a motion of the machine.
"""

import matplotlib.pyplot as plt
import numpy as np

from dynkit import continue_orbit
from dynkit.systems import ImpactChain, SoftStop

plt.style.use("dynkit.plotting.journal")
pad = SoftStop(0, offset=-0.5, stiffness=3.0, name="pad")
machine = ImpactChain(masses=1, damping=0.05, frequency=0.3, harmonic_forces=[0.2], elements=[pad])
linear = continue_orbit(
    machine.attractor().periodic_orbit(), "frequency", bounds=(0.3, 1.5), largest_step=0.1
)
(reaching,) = linear.bifurcations[0].switch()
pressing = continue_orbit(reaching, "frequency", bounds=(0.3, 1.5), largest_step=0.1)
figure, axes = plt.subplots()
for branch in (linear, pressing):
    orbits = [branch.orbit(i) for i in range(0, len(branch), 2)]
    depth = [-o.sample(np.linspace(0.0, o.period, 300))[0].min() for o in orbits]
    kinds = np.where(branch.admissible, np.where(branch.stable, "-", "--"), ":")[::2]
    for kind, name in (("-", "stable"), ("--", "unstable"), (":", "inadmissible")):
        shown = np.where(kinds == kind, depth, np.nan)
        axes.plot(branch.parameter[::2], shown, f"k{kind}", label=name)
axes.axhline(0.5, color="0.8", lw=0.5, zorder=0, label="stop")
axes.set(xlabel=r"frequency $\omega$", ylabel="largest displacement to the stop")
handles = axes.get_lines()
axes.legend(handles=[*handles[:3], handles[-1]])
