"""All branches of the logistic map.

Orbits of one, two, three and four iterates, stable (solid) and unstable (dashed), with the folds
(SN) and period doublings (PD) where they begin. `explore` finds them without a guess.
"""

from dynkit import explore
from dynkit.systems import Logistic

network = explore(Logistic(rate=3.0), "rate", (2.5, 4.0), iterates=4, box=[(0.0, 1.0)])
network.plot()
