"""The dimension of Ikeda's attractor.

Local slopes of the correlation sum against the distance. The region of constant slope is found,
and its slope is the correlation dimension with its error.
"""

from dynkit.analysis import CorrelationDimension
from dynkit.systems import Ikeda

attractor = Ikeda(u=0.9).attractor(start=[0.1, 0.1], keep=100_000)
CorrelationDimension(attractor).plot_slopes(label="Ikeda")
