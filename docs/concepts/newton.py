"""A weak impact that vanishes: the derivative of the impact map, and the impulse."""

import numpy as np
from matplotlib import pyplot as plt

from dynkit import continue_orbit
from dynkit.plotting.figures import print_style
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=0.87)
single = continue_orbit(chain.periodic_orbit(impacts=1, periods=3), "frequency", bounds=(0.8, 0.9))
grazing = single.bifurcations[0]
branch = continue_orbit(grazing.switch()[0], "frequency", bounds=(0.78, 0.83))
orbits = [branch.orbit(i) for i in range(len(branch))]
motions = [orbit for orbit in orbits if orbit.admissible]
distances = [grazing.value - orbit.system.frequency for orbit in motions]
steepest = [abs(orbit.system.jacobian(orbit.states[0])).max() for orbit in motions]
impulses = np.array([orbit.impulses[1] for orbit in orbits])
with print_style():
    figure = plt.figure(figsize=(6.8, 2.3), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(distances, steepest, "ko", ms=2.5)
    left.set(xlabel="distance of the frequency from GR", ylabel="largest entry of the derivative")
    left.set(xlim=(1e-4, 5e-2), ylim=(5.0, 5e3))
    for kind, style in ((branch.admissible, "k-"), (~branch.admissible, "k:")):
        right.plot(branch.parameter, np.where(kind, impulses, np.nan), style, lw=0.9)
    right.plot(grazing.value, 0.0, "ko", ms=3.5, mfc="white")
    right.annotate("GR", (grazing.value, 0.0), textcoords="offset points", xytext=(5, 5))
    right.set(xlabel="frequency", ylabel="impulse of the weak impact")
