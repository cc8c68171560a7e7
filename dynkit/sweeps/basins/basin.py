"""One basin of attraction."""

from dataclasses import dataclass
from typing import final

from dynkit.core.validation import Array
from dynkit.labels.label import OrbitLabel


@final
@dataclass(frozen=True, eq=False)
class Basin:
    """An attractor, and the fraction of the starts that lead to it.

    Parameters
    ----------
    number : int
        Number of the attractor in `Basins.numbers`.
    label : OrbitLabel
        Label of the motion from the first start in the basin.
    ending : str
        Why the simulation of that start ended; for a motion without impacts, why there are none.
    states : (n, d) array
        The states of the orbit, in their order, read-only. Chaotic and quasi-periodic motions have
        a sample of their states, motions without impacts have none.
    start : tuple of int
        Index of the first start in the basin.
    count : int
        Number of starts in the basin.
    fraction, error : float
        The fraction of all starts, and its standard error if the starts were drawn at random.
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
