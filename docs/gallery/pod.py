"""Proper orthogonal modes.

The modes that hold most of the power of a chaotic motion of ten masses, beside the normal modes
that resemble them most. MAC is the modal assurance criterion: 1 where two modes are the same.
"""

from dynkit.analysis import POD
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=1.346)
POD(chain.attractor(impacts=5000)).plot_modes(count=4)
