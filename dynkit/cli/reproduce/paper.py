"""What is held against what was found, and from where it is.

J. P. Cusumano, B.-Y. Bai, "Period-infinity periodic motions, chaos, and spatial coherence in a 10
degree of freedom impact oscillator", Chaos, Solitons & Fractals 3 (1993) 515-535.
"""

from typing import NamedTuple

ITEMS = (
    "table-a1",
    "figure-3",
    "figure-4",
    "figure-4-branches",
    "figure-5",
    "figure-6a",
    "figure-6b",
    "figure-7",
    "figure-8",
    "figure-9",
    "figure-10",
    "figure-11",
    "figure-12",
    "figure-13",
    "figure-16",
    "figure-17",
    "differences",
)
"""What `dynkit reproduce` makes, in the order of the report."""

# Section 4 of the paper: the chain, and how its diagrams were made.
MASSES, DAMPING, RESTITUTION, AMPLITUDE, OFFSET = 10, 0.1, 0.85, 0.1, 0.0
TRANSIENT, KEPT = 700, 100
FREQUENCIES = (0.14, 2.0, 0.002)
BLOW_UPS = ((0.36, 0.44, 2e-4), (0.70, 0.76, 2e-4))
TABLE_VELOCITY = 0.014

# Table A1.
NATURAL_FREQUENCIES = (0.150, 0.445, 0.731, 1.000, 1.247, 1.466, 1.652, 1.802, 1.911, 1.978)

# Figure 6: "nonlinear resonances" at these frequencies.
PEAKS = (0.202, 0.408)

# Figure 3: the ratios "converge to the coefficient of restitution"; "a spurious divergence occurs
# after about 80 impacts".
DIVERGENCE = 80

# Upper ends of the axes of the figures.
AXIS_4, AXES_5, AXIS_6A, AXIS_6B = 0.5, (0.06, 0.10), 0.20, 0.025

LABELS = {
    0.16: "P(7,1)",
    0.28: "P(2,1)",
    0.33: "P(5,2)",
    0.408: "P(inf,2)",
    0.46: "P(4,2)",
    0.55: "P(2,2)",
    0.64: "P(1,1)",
    0.67: "P(3,3)",
    0.79: "P(2,3)",
    0.87: "P(1,3)",
    1.2: "P(1,4)",
    1.31: "P(2,5)",
    1.5: "P(1,5)",
    1.75: "P(1,6)",
}
"""Labels along the sweep of figure 4, by frequency.

An independent computation, with a sampled search for impacts, gave them. At 0.40816 the paper
reads P(inf,4): see STICKING.
"""

# Labels of the paper's text and Table 1 that are looked into by the item "differences".
STICKING = (0.40816, "P(inf,4)")
LONG_PERIOD = (0.36, "P(.,32)")
TABLE_1_CHAOS, TEXT_CHAOS = 1.336, 1.346
CHAOS = 0.35


class Shown(NamedTuple):
    """A motion of figures 7 to 12: table periods in a period of it, and what the figures show."""

    frequency: float
    periods: int | None
    end: float
    spectrum: str
    impacts: str
    stroboscopic: str
    parting: str


# By the figure that shows the series; `end` is that of its time axis.
SHOWN = {
    7: Shown(0.870, 3, 100.0, "lines of period 3", "1 point", "3 points", "no change"),
    9: Shown(
        STICKING[0],
        4,
        140.0,
        "lines of period 4",
        "points that run up to the table's velocity",
        "4 points",
        "no change",
    ),
    11: Shown(
        CHAOS,
        None,
        140.0,
        "broad-band",
        "a complicated attractor",
        "a complicated attractor",
        "diverge after about 100 impacts",
    ),
}
SPECTRUM_AXIS = 6.0

# Section 4: what differs at first between two motions.
DISTANCE = 1e-8

# Figures 13, 16 and 17: frequency, damping, and interval of the 2000 time steps.
SURFACES = {
    "13": (STICKING[0], 0.1, 0.2),
    "16a": (CHAOS, 0.1, 0.2),
    "16b": (0.36, 0.01, 0.2),
    "17": (0.870, 0.1, 0.1),
}
STEPS = 2000
