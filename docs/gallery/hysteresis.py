"""Hysteresis of a joint that slips.

Iwan's model of a joint: twenty springs, each in series with a slider, in parallel. The area of a
loop is the energy that the joint dissipates in a period. Small loops stay where the sliders were
left.
"""

import matplotlib.pyplot as plt
import numpy as np

from dynkit.systems import ImpactChain, iwan

plt.style.use("dynkit.plotting.journal")
figure, axes = plt.subplots()
for force, look in ((0.5, ":"), (1.0, "--"), (1.5, "-")):
    joint = iwan(0, stiffness=3.0, force=0.8, elements=20, name="lap")
    machine = ImpactChain(masses=1, frequency=0.5, harmonic_forces=[force], elements=joint)
    record = machine.simulate(impacts=30)
    times = np.linspace(record.time[-2], record.time[-1], 800)
    x, slid = record.sample(times)[0], record.sample_sliders(times)
    pull = sum(e.stiffness * (x[:, 0] - slid[:, i]) for i, e in enumerate(joint))
    axes.plot(x, pull, f"k{look}", label=f"{force}")
axes.set(xlabel="displacement $x$", ylabel="force of the joint")
figure.legend(title="amplitude of the forcing", loc="outside upper center", ncols=3)
