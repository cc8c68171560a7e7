"""A plane of two parameters.

Labels of the motions of one mass at a stop, against the frequency and the place of the stop.
"""

import numpy as np

from dynkit import parameter_map
from dynkit.systems import SingleImpactOscillator

mass = SingleImpactOscillator(frequency=2.0, restitution=0.7)
values = {"frequency": np.linspace(1.6, 3.6, 50), "stop": np.linspace(-0.4, 0.2, 36)}
parameter_map(mass, values, transient=300, keep=40, progress=False).plot()
