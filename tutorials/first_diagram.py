"""What does my own chain do when the table shakes faster? A first hour with dynkit.

Run it from any folder: it writes first_diagram.png there.
"""

from __future__ import annotations

import numpy as np

from dynkit import sweep
from dynkit.analysis import BifurcationDiagram
from dynkit.systems import ImpactChain


class TaperedChain(ImpactChain):
    """Five masses that get lighter towards the table: other energies, nothing else."""

    def kinetic(self, v):
        return sum(speed**2 / (2 * (1 + i)) for i, speed in enumerate(v))


# One motion: every impact, and the motion between the impacts, to rounding.
chain = TaperedChain(masses=5, frequency=0.9)
record = chain.simulate(impacts=200)
position, velocity = record.sample(np.linspace(0.0, 10.0, 6))
print(record)
print("tip at six times:", position[:, -1].round(4))
print("errors of the first and of the last impact:", record.error[[0, -1]])

# What is left of it after a transient, and what it is called.
attractor = chain.attractor(transient=700, impacts=100)
print("at frequency 0.9 it settles on", attractor.label)

# The same for many frequencies, each from where the one before it ended.
result = sweep(chain, "frequency", np.arange(0.6, 1.2, 0.005), progress=False)
print(f"{result.cost.counts['impacts']} impacts in {result.cost.seconds:.2f} s")
axes = BifurcationDiagram.of(result).plot()
axes.figure.savefig("first_diagram.png", dpi=200)
