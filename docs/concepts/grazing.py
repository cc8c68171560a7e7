"""The square root of grazing, drawn from the impact map of one mass."""

import numpy as np
from matplotlib import pyplot as plt

from dynkit.plotting.figures import print_style
from dynkit.systems import SingleImpactOscillator

mass = SingleImpactOscillator(frequency=4.0, restitution=0.8)
phase = 4.37


def flight(velocity):
    """Return the motion from an impact to the next one."""
    return mass.simulate(impacts=1, start=mass.impact_state([velocity, phase]))


hit, miss = 0.2, 0.4
for _ in range(50):  # bisection: does the mass meet the stop before time 2?
    middle = 0.5 * (hit + miss)
    hit, miss = (middle, miss) if flight(middle).time[0] < 2.0 else (hit, middle)
velocities = np.linspace(0.25, 0.4, 2000)
following = [flight(u).relative_velocity[0] for u in velocities]
distances = np.geomspace(1e-12, 1e-1, 60)
with print_style():
    figure = plt.figure(figsize=(6.8, 2.3), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for velocity, style in ((0.28, ":"), (hit, "-"), (0.36, "--")):
        record = mass.simulate(impacts=2, start=mass.impact_state([velocity, phase]))
        times = np.linspace(0.0, 2.4, 600)
        left.plot(times, -record.sample(times)[0][:, 0], f"k{style}", label=f"$u$ = {velocity:.3f}")
    left.set(xlabel="time $t$", ylabel="gap")
    left.legend(fontsize=6.0)
    middle.plot(velocities, following, "k.", ms=0.8)
    middle.set(xlabel="velocity $u$ after an impact", ylabel="velocity after the next")
    right.loglog(distances, [flight(hit - d).relative_velocity[0] for d in distances], "k.", ms=3)
    right.loglog(distances, distances**0.5, color="0.6", lw=0.7)
    right.set(xlabel="distance from grazing", ylabel="velocity after the next")
