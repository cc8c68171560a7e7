"""Basins of an impact pair.

A free mass rattles in a vibrating housing. Which motion it settles on depends on its velocity at
the start and on the phase of the housing.
"""

import numpy as np

from dynkit import basins
from dynkit.systems import PlayOscillator

pair = PlayOscillator(play=1.0, amplitude=0.4, frequency=1.0, restitution=0.6)
phases = np.linspace(0.0, 2.0 * np.pi, 60)
velocities = np.linspace(-2.0, 2.0, 60)
starts = [[[0.0, v, p] for v in velocities] for p in phases]
found = basins(pair, starts, transient=200, keep=40, progress=False)
found.plot()
