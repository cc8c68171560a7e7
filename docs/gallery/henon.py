"""Henon's map.

Iterates on the strange attractor, and the unstable orbits of up to four iterates that a search of
a box finds. They are two fixed points, one of them on the attractor, and cycles of two and four.
"""

import matplotlib.pyplot as plt

from dynkit import find_orbits
from dynkit.systems import Henon

henon = Henon(a=1.4, b=0.3)
states = henon.attractor(start=[0.0, 0.0], keep=100_000).states
plt.style.use(["dynkit.plotting.journal", "dynkit.plotting.colour"])
figure, axes = plt.subplots()
axes.plot(*states.T, "k,", alpha=0.3, rasterized=True)
for orbit, mark in zip(find_orbits(henon, 4, [(-1.5, 1.5), (-0.5, 0.5)]), "oDs^", strict=True):
    axes.plot(*orbit.states.T, mark, ms=4, mfc="none", label=f"P({orbit.period})")
axes.set(xlabel="$x$", ylabel="$y$")
axes.legend(loc="center left")
