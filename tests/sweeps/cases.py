"""Short sweeps."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynkit import Sweep, sweep
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain, Logistic

CHAIN = ImpactChain(masses=3, frequency=0.9)
FREQUENCIES = np.linspace(0.5, 1.5, 12)
SHORT: dict[str, Any] = {"transient": 30, "keep": 20, "progress": False}
RATES = np.linspace(3.4, 3.9, 40)
START = [0.3]


@dataclass(frozen=True)
class Counted(Logistic):
    """Counts its calls, and does something else instead at one of them."""

    calls: ClassVar[int] = 0
    trap: ClassVar[tuple[int, type[BaseException]] | None] = None
    jacobian = Logistic.jacobian

    def __call__(self, state: Array) -> Array:
        Counted.calls += 1
        if self.trap is not None and Counted.calls == self.trap[0]:
            error, Counted.trap = self.trap[1], None  # what a method assigns is not compared
            raise error
        return super().__call__(state)


class SoftChain(ImpactChain):
    """Another class, with the energies of the chain."""


def sweep_rates(store: Path | None = None, **changed: Any) -> Sweep:
    arguments: dict[str, Any] = {
        "transient": 50,
        "keep": 20,
        "start": START,
        "progress": False,
        **changed,
    }
    return sweep(Counted(3.5), "rate", RATES, store=store, **arguments)


def assert_same_bits(a: Sweep, b: Sweep) -> None:
    for name in a.observables:
        assert a.observable(name).tobytes() == b.observable(name).tobytes()
    assert a.counts.tolist() == b.counts.tolist()
    assert a.endings == b.endings
    assert a.cost.counts == b.cost.counts


def no_space(handle: int) -> None:
    raise OSError(28, "No space left on device")
