"""Lorenz orbits that end at a homoclinic orbit.

Unstable orbits (dashed) are born at the Hopf point (HB) of an equilibrium. At smaller rho they
come nearer to the origin, and stay there longer. At rho = 13.926 the period is infinite.
"""

import matplotlib.pyplot as plt

from dynkit import continue_orbit, equilibrium
from dynkit.systems import SymbolicFlow


class Lorenz(SymbolicFlow):
    rho: float = 20.0

    def velocity(self, x, y, z):
        return 10 * (y - x), x * (self.rho - z) - y, x * y - 8 * z / 3


rests = continue_orbit(equilibrium(Lorenz(), [7.0, 7.0, 19.0]), "rho", bounds=(10.0, 30.0))
(born,) = rests.bifurcations[0].switch()
branch = continue_orbit(born, "rho", bounds=(13.93, 25.0))
orbits = [branch.orbit(i) for i in range(len(branch))]
periods = [orbit.system.return_time(orbit.states[0]) for orbit in orbits]
plt.style.use("dynkit.plotting.journal")
figure, axes = plt.subplots()
axes.plot(branch.parameter, periods, "k--")
axes.axvline(13.926, color="0.7", lw=0.6)
axes.text(14.1, 3.4, "homoclinic orbit")
axes.text(24.2, 0.8, "HB")
axes.set(xlabel=r"$\rho$", ylabel="period")
