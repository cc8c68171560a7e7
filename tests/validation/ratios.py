"""True errors over claimed ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array

LOST = 0.1
"""Where this error is claimed, of numbers about 1, nothing is claimed any more."""


@dataclass(frozen=True)
class Ratios:
    """Of some cases, but for those that are lost and say so.

    Parameters
    ----------
    true, claimed : (n,) arrays
    lost : int
        Cases of which nothing is claimed.
    """

    true: Array
    claimed: Array
    lost: int

    @staticmethod
    def of(pairs: Iterable[tuple[float, float]]) -> Ratios:
        """From pairs of a true error and a claimed one."""
        both = np.array(list(pairs)).reshape(-1, 2)
        claims = both[:, 1] < LOST
        true, claimed = both[claims].T
        return Ratios(true, claimed, int((~claims).sum()))

    @property
    def ratios(self) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.true == 0.0, 0.0, self.true / self.claimed)

    @property
    def exceedances(self) -> int:
        return int((self.ratios > 1.0).sum())

    def __len__(self) -> int:
        return len(self.true)

    def __str__(self) -> str:
        q = self.ratios
        return f"{len(q)} | {self.exceedances} | {np.median(q):.1g} | {q.max():.2g} | {self.lost}"
