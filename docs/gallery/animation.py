"""A chain in motion.

Six masses, each tied to the next, above a shaking table. A stop that is hit is drawn bold. Below,
the last mass and the table against time.
"""

from dynkit.systems import ImpactChain

chain = ImpactChain(masses=6, frequency=0.6)
record = chain.simulate(impacts=200)
film = record.animate(frames=60)
film.save("animation.gif", writer="pillow", dpi=90)
