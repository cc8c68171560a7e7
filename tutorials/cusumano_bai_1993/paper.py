"""What is held against what was found, and from where it is.

J. P. Cusumano, B.-Y. Bai, "Period-infinity periodic motions, chaos, and spatial coherence in a 10
degree of freedom impact oscillator", Chaos, Solitons & Fractals 3 (1993) 515-535.
"""

import re
from typing import NamedTuple

ITEMS = (
    "table-a1",
    "figure-3",
    "figure-4",
    "figure-4-branches",
    "figure-5",
    "figure-6a",
    "figure-6b",
    "resonances",
    "figure-7",
    "figure-8",
    "figure-9",
    "figure-10",
    "figure-11",
    "figure-12",
    "figure-13",
    "figure-14",
    "figure-15",
    "figure-16",
    "figure-17",
    "table-1",
    "differences",
)
"""What is made, in the order of the report."""

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

# How the paper writes parameters and observables.
SYMBOLS = {"frequency": r"\omega", "relative_velocity": "u", "energy": "E"}

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
LOOKED_INTO = (STICKING[0], LONG_PERIOD[0], TABLE_1_CHAOS, CHAOS)


def agrees(theirs: str, found: str) -> bool:
    """Whether a label is the paper's, in which a dot is a number that it leaves open.

    Examples
    --------
    >>> agrees("P(.,32)", "P(74,32)"), agrees("P(inf,4)", "P(inf,2)")
    (True, False)
    """
    return re.match(re.escape(theirs).replace(r"\.", r"\d+"), found) is not None


class Row(NamedTuple):
    """One row of Table 1 of the paper; what it does not give is None."""

    frequency: float
    damping: float
    orbit: str
    modes: int | None
    dimension: float | None = None
    error: float | None = None
    bounds: str | None = None
    scaling: float | None = None


# Scaling: largest length over the smallest. The text, not the table, has chaos at TEXT_CHAOS.
TABLE_1 = (
    Row(0.34, 0.1, "P(5,2)", 3, 1.00, 0.00, "1 to 3", 220.0),
    Row(CHAOS, 0.1, "chaotic", 3, 2.21, 0.04, "3 to 7", 20.0),
    Row(0.36, 0.1, "P(.,32)", 3, 1.00, 0.00, "1 to 3", 3.3),
    Row(0.36, 0.01, "chaotic", 5, 6.2, 0.2, "7 to 15", 2.2),
    Row(0.36, 0.001, "chaotic", 7, 9.0, 0.8, "9-10 to 19-21", 1.8),
    Row(STICKING[0], 0.1, STICKING[1], 2, 1.23, 0.01, "2 to 5", 1000.0),
    Row(0.870, 0.1, "P(1,3)", 5, 1.00, None, "1 to 3"),
    Row(TABLE_1_CHAOS, 0.1, "chaotic", 4, 2.58, 0.05, "3 to 7", 6.7),
    Row(1.750, 0.1, "P(1,6)", 5, 1.00, None, "1 to 3"),
    Row(1.916, 0.1, "chaotic", 3, 2.9, 0.1, "3 to 7", 2.7),
)

# Section 5: the part of the power that the modes hold; how many of the ten cases have 2N + 1 within
# the bounds that the dimension gives.
SHARE, WITHIN = 0.99, 5

# Figure 14: frequency. Figure 15: frequencies and dampings; of the last, the legend's digits are
# hard to read in print.
FIGURE_14, MODES_14 = STICKING[0], 4
FIGURE_15 = ((STICKING[0], 0.1), (CHAOS, 0.1), (0.36, 0.01))


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
