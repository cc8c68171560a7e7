"""Spectra: the numbers that determine the stability of a solution."""

from enum import Enum
from typing import Any, final

import numpy as np

# Distance beyond the stability border that counts as rounding, relative to one or to an
# eigenvalue's modulus.
_ROUNDING = 1e-9
# Finite number in place of an infinite multiplier in products.
_HUGE = 1e150


@final
class Spectrum(Enum):
    """Kind of the numbers, which determines the border of stability."""

    MULTIPLIERS = "Floquet multipliers: stable inside the unit circle"
    CONSERVATIVE = "Floquet multipliers on a level of an integral: stable not outside the circle"
    EIGENVALUES = "eigenvalues: stable where their real parts are negative"

    @property
    def periodic(self) -> bool:
        """Whether they are multipliers of a periodic orbit."""
        return self is not Spectrum.EIGENVALUES

    @property
    def neutral(self) -> float:
        """The number of a disturbance that is constant: 1 or 0."""
        return 1.0 if self.periodic else 0.0

    def stable(self, values: Any) -> Any:
        """Return whether the disturbance of each number decays, or on a level does not grow."""
        if self is Spectrum.CONSERVATIVE:
            return self.inside(values)
        if self is Spectrum.MULTIPLIERS:
            return abs(values) < 1.0
        return values.real < 0.0

    def inside(self, values: Any) -> Any:
        """Return whether each complex number is not beyond the border, up to rounding."""
        if self.periodic:
            return abs(values) ** 2 <= 1.0 + _ROUNDING
        return values.real <= _ROUNDING * abs(values)

    def pairs_inside(self, real: Any) -> int:
        """Return the number of pairs of real numbers with a product <= 1, or a sum <= 0.

        The product of two multipliers is compared with one, the sum of two eigenvalues with zero.
        So a complex pair inside the border that becomes two real numbers makes one such pair, and a
        complex pair outside makes none.
        """
        if self.periodic:
            real = np.clip(real, -_HUGE, _HUGE)  # infinite where an orbit grazes
            inside = np.multiply.outer(real, real) <= 1.0 + _ROUNDING
        else:
            sizes = np.add.outer(abs(real), abs(real))
            inside = np.add.outer(real, real) <= _ROUNDING * sizes
        return int(np.count_nonzero(inside) - np.count_nonzero(inside.diagonal())) // 2

    def from_border(self, values: Any) -> Any:
        """Return distances of numbers to the border, for eigenvalues relative to their modulus."""
        if self.periodic:
            return abs(abs(values) - 1.0)
        return abs(values.real) / np.where(values == 0.0, 1.0, abs(values))

    def from_number(self, values: Any, critical: float) -> Any:
        """Return distances to a critical number, for eigenvalues relative to the largest."""
        size = 1.0 if self.periodic else float(abs(values).max(initial=0.0)) or 1.0
        return abs(values - critical) / size
