"""Henon's map.

Iterates on the strange attractor, and the unstable orbits that a search of the box finds for four
iterates: two fixed points, one of them on the attractor, and cycles of two and of four.
"""

from dynkit import find_orbits
from dynkit.plotting.figures import new_figure
from dynkit.systems import Henon

henon = Henon(a=1.4, b=0.3)
states = henon.attractor(start=[0.0, 0.0], keep=100_000).states
figure, (axes,) = new_figure()
axes.plot(*states.T, "k,", alpha=0.3, rasterized=True)
for orbit in find_orbits(henon, 4, [(-1.5, 1.5), (-0.5, 0.5)]):
    mark = {1: "o", 2: "s", 4: "^"}[orbit.period]
    axes.plot(*orbit.states.T, mark, ms=4, mfc="none", label=f"P({orbit.period})")
axes.set(xlabel="$x$", ylabel="$y$")
axes.legend(fontsize=7.0, frameon=False, loc="center left")
