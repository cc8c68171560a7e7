"""Lines of Table 1: what they hold, and their cells."""

from __future__ import annotations

from dataclasses import dataclass

from dynkit.analysis import CorrelationDimension
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.measures.motions import Motion

NONE = "-"
"""What is not there."""

MOTION = ("frequency", "damping")
MODES = (
    *MOTION, "orbit, paper", "orbit, found", "N, paper", "N, found", "power in N - 1 modes, %",
    "error, %", "2N + 1, paper", "2N + 1, found",
)  # fmt: skip
DIMENSIONS = (
    *MOTION, "points", "d, paper", "d, found", "error, paper", "error, found", "scaling, paper",
    "scaling, found", "[d] to 2[d] + 1, paper", "[d] to 2[d] + 1, found", "Kaplan-Yorke", "error",
)  # fmt: skip
EXPONENTS = (
    *MOTION, "orbit, found", "largest exponent per impact", "error", "per unit of time", "error",
    "seconds",
)  # fmt: skip
"""Heads of the columns."""


@dataclass(frozen=True)
class Line:
    """A line of the table: a row of the paper's, and a motion.

    Parameters
    ----------
    row : paper.Row
    motion : Motion
    seconds : float
        What the motion and its measures took.
    """

    row: paper.Row
    motion: Motion
    seconds: float

    @property
    def place(self) -> list[str]:
        """Frequency and damping."""
        return [f"{self.row.frequency:g}", f"{self.row.damping:g}"]

    @property
    def modes(self) -> int:
        """How many modes hold 99 % of the power."""
        return self.motion.pod.rank(paper.SHARE)

    @property
    def ends(self) -> bool:
        """Whether the motion is the chaos that ends."""
        return self.row.frequency == paper.CHAOS and self.row.modes is not None

    @property
    def within(self) -> bool:
        """Whether 2N + 1 lies within the bounds that the dimension gives."""
        low, high = self.motion.bounds
        return low <= 2 * self.modes + 1 <= high


def _given(value: float | None, form: str = "g") -> str:
    return NONE if value is None else format(value, form)


def modes_of(line: Line) -> list[str]:
    """Return the cells of a line of the first part, as `MODES` heads them."""
    pod, count, theirs = line.motion.pod, line.modes, line.row.modes
    before = max(count - 2, 0)
    return [
        *line.place,
        line.row.orbit,
        line.motion.name,
        _given(theirs),
        str(count),
        f"{100.0 * pod.cumulative[before]:.3f}",
        f"{100.0 * pod.cumulative_errors[before]:.1g}",
        NONE if theirs is None else str(2 * theirs + 1),
        str(2 * count + 1),
    ]


def dimensions_of(line: Line) -> list[str]:
    """Return the cells of a line of the second part, as `DIMENSIONS` heads them."""
    row, dimension, spectrum = line.row, line.motion.dimension, line.motion.spectrum
    low, high = line.motion.bounds
    known = dimension.bounds is not None
    return [
        *line.place,
        str(len(dimension.states)),
        _given(row.dimension),
        found_dimension(dimension),
        _given(row.error),
        f"{dimension.error:.2g}" if known else NONE,
        NONE if row.scaling is None else f"{row.scaling:g}:1",
        scaling_of(dimension),
        row.bounds or NONE,
        f"{low} to {high}" + ("" if known else " (Kaplan-Yorke)"),
        f"{spectrum.dimension:.2f}",
        f"{spectrum.dimension_error:.1g}",
    ]


def found_dimension(dimension: CorrelationDimension) -> str:
    """Return a dimension: a number, that of so many points, or none."""
    if dimension.points is not None:
        return f"0 ({dimension.points} points)" if dimension.points > 1 else "0 (one point)"
    return "none" if dimension.region is None else f"{dimension.value:.2f}"


def scaling_of(dimension: CorrelationDimension) -> str:
    """Return the scaling range of a dimension, where it has one."""
    if dimension.points is not None or dimension.region is None:
        return NONE
    return f"{dimension.region.ratio:.0f}:1"


def exponents_of(line: Line) -> list[str]:
    """Return the cells of a line of the last part, as `EXPONENTS` heads them."""
    spectrum = line.motion.spectrum
    short = "" if spectrum.resolved else " (too short a run for its error)"
    return [
        *line.place,
        line.motion.name,
        f"{spectrum.exponents[0]:.5f}{short}",
        f"{spectrum.error[0]:.1g}",
        f"{spectrum.per_time[0]:.6f}",
        f"{spectrum.per_time_error[0]:.1g}",
        f"{line.seconds:.2f}",
    ]
