"""A Toda chain above a table.

Springs that get stiffer where they are stretched. The motion is followed by Taylor's method; the
picture shows the displacements of all masses in space and time.
"""

from dynkit.analysis import SpaceTime
from dynkit.systems import TodaChain

chain = TodaChain(masses=10, frequency=0.87, amplitude=0.5)
SpaceTime(chain.attractor(transient=100, impacts=12)).plot()
