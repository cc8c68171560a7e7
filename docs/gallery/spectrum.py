"""The Lyapunov spectrum of a chaotic chain.

Twenty exponents of ten masses above a table, from tangent vectors carried through every impact.
One is positive; the sum is the rate at which volumes shrink.
"""

from dynkit.analysis import LyapunovSpectrum
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=1.346)
LyapunovSpectrum(chain.attractor(), iterations=5000).plot()
