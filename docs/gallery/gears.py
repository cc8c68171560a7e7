"""Rattling gears.

A gear with backlash follows a wheel that turns unevenly. The dashed lines are the flanks of a
tooth space; each dot is an impact.
"""

from dynkit.plotting.figures import new_figure
from dynkit.systems import PlayOscillator

gear = PlayOscillator(play=0.5, amplitude=0.4, frequency=1.0, damping=0.1, restitution=0.6)
record = gear.simulate(impacts=120)
figure, (axes,) = new_figure(6.8, 2.2)
record.plot(axes, begin=20.0, end=60.0)
