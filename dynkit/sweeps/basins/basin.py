"""One basin of attraction."""

from dataclasses import dataclass
from typing import final

from dynkit.core.validation import Array
from dynkit.labels.label import OrbitLabel


@final
@dataclass(frozen=True, eq=False)
class Basin:
    """One attractor, and the part of the starts that lead to it.

    Parameters
    ----------
    number : int
        As in `Basins.numbers`.
    label : OrbitLabel
        Of the first start that leads there.
    ending : str
        Why that simulation ended: for a motion at rest, what became of it.
    states : (n, d) array
        The states of the orbit, in their order, read-only; some of them for chaos and
        quasi-periodic motions, none at rest.
    start : tuple of int
        Place of the first start that leads there.
    count : int
        How many starts do.
    fraction, error : float
        The part of all starts, and its standard error for starts that were drawn at random.
    """

    number: int
    label: OrbitLabel
    ending: str
    states: Array
    start: tuple[int, ...]
    count: int
    fraction: float
    error: float

    def __repr__(self) -> str:
        return f"<Basin {self.number}: {self.label}, of {self.count} starts>"
