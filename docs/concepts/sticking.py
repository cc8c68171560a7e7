"""Contact after a chatter: the force on the mass until it falls to zero."""

import numpy as np

from dynkit.plotting.figures import new_figure
from dynkit.systems import ImpactChain

chain = ImpactChain(masses=10, frequency=0.40816)
record = chain.attractor(transient=700, impacts=300).record
begin, end = record.sticking[1]
times = np.linspace(begin - 6.0, end + 6.0, 3000)
figure, (above, below) = new_figure(6.8, 3.6, rows=2)
record.plot(above, begin=times[0], end=times[-1])
below.plot(times, record.observable("table.contact_force", times), "k", lw=0.8)
below.set(xlabel="time $t$", ylabel="contact force", xlim=(times[0], times[-1]))
