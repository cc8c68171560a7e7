"""Lorenz orbits that end at a homoclinic orbit.

Unstable orbits are born at the Hopf point (HB) of an equilibrium. Followed to smaller rho, they
come nearer and nearer to the origin, where they stay longer and longer: at rho = 13.926 the
period is infinite.
"""

from dynkit import continue_orbit, equilibrium
from dynkit.plotting.figures import new_figure
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
figure, (axes,) = new_figure()
axes.plot(branch.parameter, periods, "k--", lw=0.9)
axes.set(xlabel=r"$\rho$", ylabel="period")
