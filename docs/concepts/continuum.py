"""A free rod that falls on a stop: wave, and rate of convergence of chains."""

import numpy as np
from matplotlib import pyplot as plt

from dynkit.plotting.figures import print_style
from dynkit.systems import ImpactRod

sizes, errors = np.array([25, 50, 100, 200, 400]), []
with print_style():
    figure = plt.figure(figsize=(6.8, 2.3), layout="constrained")
    left, right = figure.subplots(1, 2)
    for masses in sizes:
        rod = ImpactRod(masses=int(masses), far_end="free", amplitude=0.0, frequency=1.0)
        record = rod.simulate(impacts=20, start=rod.moving(0.5, -1.0))
        errors.append(record.sticking[-1, 1] - record.time[0] - 2.0)
        if masses in (25, 400):
            _, velocity = record.sample([record.time[0] + 0.6])
            style = {"color": "0.6" if masses == 25 else "k", "lw": 0.8, "label": f"$N = {masses}$"}
            left.plot(1.0 - rod.nodes, rod.displacements(velocity[0]), **style)
    left.axvline(0.6, color="k", ls=":", lw=0.7)
    left.set(xlabel="distance from the stop", ylabel="velocity")
    left.legend()
    right.loglog(sizes, errors, "ko", ms=3, label="contact time $- 2$")
    right.loglog(sizes, errors[0] * (sizes / 25.0) ** (-2 / 3), "0.6", lw=0.7, label="$N^{-2/3}$")
    right.set(xlabel="masses $N$", ylabel="error")
    right.set_xticks(sizes, sizes)
    right.minorticks_off()
    right.legend()
