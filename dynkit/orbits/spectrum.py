"""Spectra: the numbers from which the stability of a solution follows."""

from enum import Enum
from typing import Any, final

import numpy as np

# Relative to one, or to an eigenvalue's modulus: less beyond the border is rounding.
_ROUNDING = 1e-9
# What stands for infinite multipliers in products.
_HUGE = 1e150


@final
class Spectrum(Enum):
    """What the numbers are, and so on which side of which border they are stable."""

    MULTIPLIERS = "Floquet multipliers: stable inside the unit circle"
    EIGENVALUES = "eigenvalues: stable where their real parts are negative"

    @property
    def neutral(self) -> float:
        """The number of a disturbance that neither grows nor decays, and does not oscillate."""
        return 1.0 if self is Spectrum.MULTIPLIERS else 0.0

    def stable(self, values: Any) -> Any:
        """Return which of the numbers belong to disturbances that decay."""
        if self is Spectrum.MULTIPLIERS:
            return abs(values) < 1.0
        return values.real < 0.0

    def inside(self, values: Any) -> Any:
        """Return which of complex numbers are not beyond the border, but for rounding."""
        if self is Spectrum.MULTIPLIERS:
            return abs(values) ** 2 <= 1.0 + _ROUNDING
        return values.real <= _ROUNDING * abs(values)

    def pairs_inside(self, real: Any) -> int:
        """Return of how many pairs of real numbers the mean disturbance does not grow.

        A complex pair that becomes two real numbers inside the border makes one of them, and a pair
        outside none: products of multipliers are compared with one, sums of eigenvalues with zero.
        """
        upper = np.triu_indices(len(real), 1)
        if self is Spectrum.MULTIPLIERS:
            real = np.clip(real, -_HUGE, _HUGE)  # infinite where an orbit grazes
            return int(np.count_nonzero(np.outer(real, real)[upper] <= 1.0 + _ROUNDING))
        sizes = np.add.outer(abs(real), abs(real))
        return int(np.count_nonzero((np.add.outer(real, real) <= _ROUNDING * sizes)[upper]))

    def from_border(self, values: Any) -> Any:
        """Return how far numbers are from the border; eigenvalues relative to themselves."""
        if self is Spectrum.MULTIPLIERS:
            return abs(abs(values) - 1.0)
        return abs(values.real) / np.where(values == 0.0, 1.0, abs(values))

    def from_number(self, values: Any, critical: float) -> Any:
        """Return how far numbers are from a critical one; eigenvalues relative to the largest."""
        size = 1.0 if self is Spectrum.MULTIPLIERS else float(abs(values).max(initial=0.0)) or 1.0
        return abs(values - critical) / size
