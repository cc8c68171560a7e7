"""Quasi-periodic motion of the chain: closed curves, and their rotation number."""

import numpy as np
from matplotlib import pyplot as plt

from dynkit import continue_orbit
from dynkit.plotting.figures import print_style
from dynkit.plotting.points import RELATIVE_VELOCITY, displacement
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=0.5322)
orbit = chain.periodic_orbit(impacts=1, periods=1)
branch = continue_orbit(orbit, "frequency", bounds=(0.53, 0.534), inadmissible=False)
(torus,) = branch.bifurcations
turns = abs(np.angle(torus.orbit.multipliers[0])) / (2.0 * np.pi)
with print_style():
    figure = plt.figure(figsize=(6.8, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(torus.orbit.states[:, 0], torus.orbit.relative_velocity, "k+", ms=5)
    right.plot(torus.value, turns, "k+", ms=5)
    for distance in np.linspace(1e-4, 6e-4, 6):
        near = chain.replace(frequency=torus.value - distance)
        motion = near.attractor(transient=6000, impacts=3000)
        left.plot(motion.record.position[:, 0], motion.record.relative_velocity, "k.", ms=0.5)
        right.plot(near.frequency, motion.label.rotation_number, "ko", ms=3)
    left.set(xlabel=displacement(0), ylabel=RELATIVE_VELOCITY)
    right.set(xlabel=r"frequency $\omega$", ylabel="rotation number")
