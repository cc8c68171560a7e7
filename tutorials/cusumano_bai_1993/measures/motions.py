"""The motions of Table 1 and figures 14 and 15, and their measures."""

from __future__ import annotations

from functools import cached_property
from math import ceil, pi
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.analysis import POD, CorrelationDimension, LyapunovSpectrum
from tutorials.cusumano_bai_1993.measures.transient import VERY_LONG, LongRun

if TYPE_CHECKING:
    from dynkit import OrbitLabel
    from dynkit.systems import ImpactAttractor, ImpactChain
    from tutorials.cusumano_bai_1993.arrays import Array

# Impacts of a periodic motion: many periods of all of them. Of a chaotic one: the points of the
# paper's dimensions. Iterates of exponents: what makes them good to 2 % in chaos.
_PERIODIC, _POINTS = 10_000, 100_000
_ITERATES_PERIODIC, _ITERATES = 20_000, 40_000
# Exponents take this many times the impacts that they stand on.
_LEAD = 1.25
# Largest radius of a dimension, over the largest extent of positions and velocities.
_PART = 0.1


@final
class Motion:
    """A motion and its measures, each of them worked out when it is first asked for.

    Parameters
    ----------
    name : str
        What it is called in the report.
    label : OrbitLabel
    attractor : ImpactAttractor
        Its proper orthogonal modes are those of the time from the last skipped impact on.
    iterations : int
        Impacts that the Lyapunov exponents stand on.
    states : (n, 2N) array, optional
        Section states that the dimension is that of; by default those of the attractor.
    begin : (2N,) array, optional
        Section state from which the exponents begin; by default the attractor's last.
    """

    def __init__(
        self,
        name: str,
        label: OrbitLabel,
        attractor: ImpactAttractor,
        iterations: int,
        states: Array | None = None,
        begin: Array | None = None,
    ) -> None:
        self.name = name
        self.label = label
        self.attractor = attractor
        self.states = attractor.states if states is None else states
        self._iterations = iterations
        self._begin = attractor.states[-1] if begin is None else begin

    @cached_property
    def pod(self) -> POD:
        """Its proper orthogonal decomposition."""
        return POD(self.attractor)

    @cached_property
    def dimension(self) -> CorrelationDimension:
        """Its correlation dimension, in the section.

        Of chaos the largest radius is a tenth of the largest extent of positions and velocities:
        the phase alone tells states that are farther apart from one another.
        """
        if self.label.periods is not None:
            return CorrelationDimension(self.attractor)
        extent = float(np.ptp(self.states[:, :-1], axis=0).max())
        return CorrelationDimension(
            self.states, angles={self.states.shape[1] - 1: 2.0 * pi}, largest=_PART * extent
        )

    @cached_property
    def spectrum(self) -> LyapunovSpectrum:
        """Its Lyapunov exponents."""
        return LyapunovSpectrum.of_map(
            self.attractor.system, self._begin, iterations=self._iterations
        )

    @property
    def bounds(self) -> tuple[int, int]:
        """Bounds [d] and 2 [d] + 1, of Kaplan and Yorke's d where no correlation dimension is."""
        found = self.dimension.bounds
        if found is not None:
            return found
        least = ceil(self.spectrum.dimension - self.spectrum.dimension_error)
        return least, 2 * least + 1


def warm_up(chain: ImpactChain) -> None:
    """Compile the kernels of the measures, or load them."""
    label = chain.attractor().label
    few = Motion(str(label), label, chain.attractor(), 200)
    assert few.pod.power.any()
    assert few.dimension.sums.total
    assert few.spectrum.exponents.any()


def settled_motion(chain: ImpactChain) -> Motion:
    """Return the motion that a chain has after very many impacts, periodic or chaotic."""
    label = chain.attractor().settled_label()
    count = _POINTS
    if label.periods is not None:
        # whole periods: then time averages are exact
        period = label.iterates or 1
        count = period * (_PERIODIC // period)
    attractor = chain.attractor(transient=VERY_LONG, impacts=count)
    iterations = _ITERATES_PERIODIC if label.periods is not None else _ITERATES
    return Motion(str(label), label, attractor, iterations)


def transient_motion(chain: ImpactChain, runs: list[LongRun]) -> Motion:
    """Return the chaos that ends: of the longest run, and all points for the dimension."""
    longest = max(runs, key=lambda run: run.chaotic)
    begin = chain.impact_state(longest.state)
    lengths = sorted(run.chaotic for run in runs)
    return Motion(
        f"chaotic for {lengths[0]} to {lengths[-1]} impacts",
        chain.attractor(transient=0, start=begin).label,
        chain.attractor(transient=0, impacts=longest.chaotic, start=begin),
        int(longest.chaotic / _LEAD),
        np.concatenate([run.states for run in runs])[:_POINTS],
        longest.state,
    )
