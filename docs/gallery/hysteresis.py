"""Hysteresis of a joint that slips.

Iwan's model of a joint: twenty springs, each in series with a slider, in parallel. The area of a
loop is the energy that the joint dissipates in a period. Small loops stay where the sliders were
left.
"""

import numpy as np

from dynkit.plotting.figures import new_figure
from dynkit.systems import ImpactChain, iwan

figure, (axes,) = new_figure()
for force, shade in ((0.5, "0.6"), (1.0, "0.4"), (1.5, "0.0")):
    joint = iwan(0, stiffness=3.0, force=0.8, elements=20, name="lap")
    machine = ImpactChain(masses=1, frequency=0.5, harmonic_forces=[force], elements=joint)
    record = machine.simulate(impacts=30)
    times = np.linspace(record.time[-2], record.time[-1], 800)
    x, slid = record.sample(times)[0], record.sample_sliders(times)
    pull = sum(e.stiffness * (x[:, 0] - slid[:, i]) for i, e in enumerate(joint))
    axes.plot(x, pull, color=shade, lw=0.9, label=f"force {force}")
axes.set(xlabel="displacement $x$", ylabel="force of the joint")
axes.legend(loc="upper left", fontsize=7.0, frameon=False)
