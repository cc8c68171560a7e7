"""What several items of the reproduction share."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dynkit import OrbitKind
from dynkit.systems import ImpactAttractor, ImpactChain, ImpactState
from tutorials.cusumano_bai_1993 import paper

if TYPE_CHECKING:
    from dynkit import Sweep
    from tutorials.cusumano_bai_1993.arrays import Array
    from tutorials.cusumano_bai_1993.measures.motions import Motion
    from tutorials.cusumano_bai_1993.measures.transient import LongRun

# Impacts until a motion that settles soon has settled; and how many are kept of it, and of chaos.
_SETTLED, _FEW, _MANY = 16_000, 400, 3000

# Chaos that ends does so when the last digits decide: as many are tried until it lasts.
_ROUNDINGS = 60

# The error is estimated at every so many values.
_EVERY = 10
# Where it is larger than this, rounding has grown as large as the motion, or is about to.
_MEANINGLESS = 1e-3


@dataclass(frozen=True, kw_only=True)
class SteadyTableChain(ImpactChain):
    """A chain whose table has the same largest velocity at every frequency.

    Parameters
    ----------
    table_velocity : float
        Amplitude times frequency; the amplitude follows.
    masses, springs, damping, restitution, offset, frequency, chatter_tolerance
        As for `ImpactChain`.

    Examples
    --------
    >>> chain = SteadyTableChain(frequency=0.25, table_velocity=0.125)
    >>> chain.amplitude, chain.replace(frequency=0.5).amplitude
    (0.5, 0.25)
    """

    table_velocity: float = paper.TABLE_VELOCITY
    amplitude: float = field(init=False)

    structure_independent: ClassVar[frozenset[str]] = ImpactChain.structure_independent | {
        "table_velocity"
    }

    def __post_init__(self) -> None:
        self._set("amplitude", self.table_velocity / self.frequency)
        super().__post_init__()


class Stopwatch:
    """Seconds by the name of the work."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def time(self, work: str) -> Generator[None]:
        """Add the time that the context takes."""
        began = time.perf_counter()
        yield
        self.seconds[work] = self.seconds.get(work, 0.0) + time.perf_counter() - began


class Workshop:
    """The paper's chain, and the sweep that figures 4 and 6a show.

    Parameters
    ----------
    folder : Path
        Where figures go.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def chain(self, frequency: float, damping: float = paper.DAMPING) -> ImpactChain:
        """Return the paper's chain."""
        return ImpactChain(
            masses=paper.MASSES,
            damping=damping,
            restitution=paper.RESTITUTION,
            amplitude=paper.AMPLITUDE,
            offset=paper.OFFSET,
            frequency=frequency,
        )

    @cache  # noqa: B019  the workshop lives as long as the run
    def warm_up(self) -> float:
        """Compile the kernels, or load them, and return the seconds that it took."""
        began = time.perf_counter()
        self.chain(0.408).attractor(transient=200, impacts=200)
        return time.perf_counter() - began

    @cache  # noqa: B019  as above
    def shown(self, frequency: float, damping: float = paper.DAMPING) -> ImpactAttractor:
        """Return a motion of figures 7 to 13, 16 and 17, from the paper's start.

        What settles has settled; the chaos that ends is the one that the paper saw.
        """
        chain = self.chain(frequency, damping)
        if (frequency, damping) == (paper.CHAOS, paper.DAMPING):
            return next(found for found in _stretches(chain) if _goes_on(found))
        attractor = chain.attractor(transient=_SETTLED, impacts=_FEW)
        if attractor.label.periods is not None:
            return attractor
        return chain.attractor(transient=_SETTLED, impacts=_MANY)

    @cached_property
    def sweep(self) -> Sweep:
        """The sweep of figure 4."""
        return self.swept(self.chain(paper.FREQUENCIES[0]), frequencies(paper.FREQUENCIES))

    @cached_property
    def sweep_error(self) -> tuple[str, str]:
        """`error_of` the sweep of figure 4."""
        return error_of(self.sweep)

    @cached_property
    def blow_ups(self) -> list[Sweep]:
        """The sweeps of figure 5, each from the state that figure 4 has there."""
        ranges = [frequencies(limits) for limits in paper.BLOW_UPS]
        return [
            self.swept(self.chain(values[0]), values, self.state_before(values[0]))
            for values in ranges
        ]

    @cached_property
    def long_runs(self) -> list[LongRun]:
        """Runs from several starts, far longer than the paper's, of its chaos that ends."""
        from tutorials.cusumano_bai_1993.measures.transient import long_runs

        return long_runs(self.chain(paper.CHAOS))

    @cached_property
    def transient(self) -> Motion:
        """The chaos of these runs before it ends."""
        from tutorials.cusumano_bai_1993.measures.motions import transient_motion

        return transient_motion(self.chain(paper.CHAOS), self.long_runs)

    @cache  # noqa: B019  as above
    def settled(self, frequency: float, damping: float = paper.DAMPING) -> Motion:
        """Return the motion of Table 1 after very many impacts."""
        from tutorials.cusumano_bai_1993.measures.motions import settled_motion

        return settled_motion(self.chain(frequency, damping))

    def state_before(self, frequency: float) -> ImpactState:
        """Return the last state of the sweep of figure 4 before a frequency."""
        place = int(np.searchsorted(self.sweep.values, frequency - 1e-9)) - 1
        attractor = self.sweep.attractor(place)
        assert isinstance(attractor, ImpactAttractor)
        return attractor.final

    @staticmethod
    def swept(chain: ImpactChain, values: Array, start: object = None) -> Sweep:
        """Return a sweep of the frequency as the paper made it, with velocity and energy."""
        from dynkit import sweep

        return sweep(
            chain,
            "frequency",
            values,
            transient=paper.TRANSIENT,
            keep=paper.KEPT,
            observables=("relative_velocity", "energy"),
            start=start,
            progress=False,
        )


def _stretches(chain: ImpactChain) -> Iterator[ImpactAttractor]:
    """Motions from the paper's start and from what differs from it in the last digits."""
    for digits in range(_ROUNDINGS):
        start = chain.state((1.0 + 2.0**-50 * digits) * chain.modal_matrix[:, 0])
        yield chain.attractor(transient=paper.TRANSIENT, impacts=_MANY, start=start)


def _goes_on(attractor: ImpactAttractor) -> bool:
    """Whether its chaos outlasts what is kept, as far as is seen, and by as much again."""
    chain, last = attractor.system, attractor.states[-1]
    ahead = chain.attractor(transient=_MANY, start=chain.impact_state(last))
    return all(each.label.kind is OrbitKind.CHAOTIC for each in (attractor, ahead))


def frequencies(limits: tuple[float, float, float]) -> Array:
    """Return the values from the first to the last of the limits, in steps of the third."""
    first, last, step = limits
    values = first + step * np.arange(round((last - first) / step) + 1.0)
    # steps such as 0.002 have no exact binary form: 0.872, not 0.8720000000000001
    return np.round(values, 12)


def error_of(sweep: Sweep) -> tuple[str, str]:
    """Return the error estimates of a sweep: in short, and in words."""
    errors = np.array([sweep.attractor(i).error for i in range(0, len(sweep), _EVERY)])
    settled = errors < _MEANINGLESS
    if not settled.any():
        return "as large as the motion", "Rounding grows to the size of the motion everywhere."
    median, most = np.median(errors[settled]), np.quantile(errors[settled], 0.95)
    words = (
        f"The error of single states was estimated at every {_EVERY}th value: median "
        f"{median:.1e}, and below {most:.1e} at 95 % of the {settled.sum()} values where it stays "
        f"below {_MEANINGLESS:g}. At the other {(~settled).sum()} rounding grows to the size of "
        "the motion, in this computation as in any other: the distribution of states has a "
        "meaning there, the single state has none."
    )
    return f"{median:.0e}", words
