"""Figure 4 with the branches of periodic orbits that its motions lie on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit import explore, view
from dynkit.analysis import BifurcationDiagram
from dynkit.plotting.figures import new_figure, print_style, save_figure
from dynkit.systems import ImpactAttractor, ImpactOrbit
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.drawing import DOTS
from tutorials.cusumano_bai_1993.paper import SYMBOLS
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit import Bifurcation, Branch, Network, PeriodicOrbit, Sweep
    from dynkit.systems import ImpactChain
    from tutorials.cusumano_bai_1993.arrays import Array

IMPACTS, PERIODS = 2, 7
"""The orbits are P(n,m), with n and m at most so large."""

# All P(1,m) at so many frequencies to start from.
_STARTS = 7
# Motions of the sweep are compared at every so many values, when their velocities differ by no more
# than this from those so many impacts before, and at the latest after the last number of impacts.
_EVERY, _STILL, _BLOCK, _LONGER = 5, 1e-13, 1000, 20_000
# Time series in the page of the sweep, and of the branches.
_MOTIONS = 120
# The same motion, where the branch is right to rounding and the motion has settled.
_SAME = 1e-9
_DOTS = {**DOTS, "color": "0.62"}


def figure_4_branches(workshop: Workshop) -> Section:
    """Make figure 4 with branches drawn over it, and list their bifurcations."""
    watch = Stopwatch()
    with watch.time("sweep"):
        sweep = workshop.sweep
    with watch.time("branches"):
        low, high, _ = paper.FREQUENCIES
        network = network_of(workshop.chain(low), (low, high), sweep)
    with watch.time("drawing"):
        figure = _figure(sweep, network)
        save_figure(figure, workshop.folder / "figure-4-branches", 300.0)
    page = "figure-4-branches.html"
    with watch.time("page"):
        view(sweep, network, out=workshop.folder / page, motions=_MOTIONS, show=False)
    with watch.time("comparison"):
        compared = compare(network, sweep)
    return Section(
        "figure-4-branches",
        "Figure 4 and its branches",
        _text(network, compared),
        _findings(network, compared),
        ["figure-4-branches"],
        watch.seconds,
        page,
    )


def network_of(chain: ImpactChain, bounds: tuple[float, float], sweep: Sweep) -> Network:
    """Return all branches of P(1,m) of a chain, and of P(2,m) that branch off or are seen."""
    starts = np.linspace(*bounds, _STARTS + 2)[1:-1].tolist()
    seeds: list[PeriodicOrbit] = [
        orbit
        for m in range(1, PERIODS + 1)
        for frequency in starts
        for orbit in chain.replace(frequency=frequency).periodic_orbits(periods=m)
    ]
    for place in _places(sweep):
        if sweep.label(place).iterates == IMPACTS:
            attractor: Any = sweep.attractor(place)
            seeds.append(attractor.periodic_orbit())
    return explore(chain, "frequency", bounds, iterates=IMPACTS, periods=PERIODS, seeds=seeds)


def _places(sweep: Sweep) -> Iterator[int]:
    """Places of the sweep where it is at orbits as small as the branches'."""
    for place in range(0, len(sweep), _EVERY):
        label = sweep.label(place)
        if label.iterates in range(1, IMPACTS + 1) and label.periods in range(1, PERIODS + 1):
            yield place


@dataclass(frozen=True)
class Compared:
    """A motion of a sweep and the nearest orbit of its label on a branch.

    Parameters
    ----------
    frequency : float
    label : str
    distance : float
        Between their relative velocities, the largest; infinite where there is no such orbit.
    stable : bool
        Whether the orbit is stable and a motion of the chain.
    """

    frequency: float
    label: str
    distance: float
    stable: bool


def compare(network: Network, sweep: Sweep) -> list[Compared]:
    """Compare motions P(n,m) of a sweep with the branches of their labels.

    Each goes on until it has settled to rounding.
    """
    found = []
    for place in _places(sweep):
        label = sweep.label(place)
        frequency = float(sweep.values[place])
        attractor: Any = sweep.attractor(place)
        expected = _settled(attractor, label.iterates or 0)
        nearest, stable = np.inf, False
        for orbit in network.orbits(frequency, str(label)):
            assert isinstance(orbit, ImpactOrbit)
            distance = float(abs(np.sort(orbit.relative_velocity) - expected).max())
            if distance < nearest:
                nearest, stable = distance, orbit.stable and orbit.admissible
        found.append(Compared(frequency, str(label), nearest, stable))
    return found


def _settled(attractor: ImpactAttractor, impacts: int) -> Array:
    """Relative velocities of the impacts of one period, (n,), in order of size."""
    found = np.full(impacts, np.inf)
    for _ in range(_LONGER // _BLOCK):
        attractor = attractor.system.attractor(
            transient=_BLOCK - impacts, impacts=impacts, start=attractor.final
        )
        before, found = found, np.sort(attractor.record.relative_velocity)
        if abs(found - before).max() <= _STILL:
            break
    return found


def _figure(sweep: Sweep, network: Network) -> Figure:
    figure, (axes,) = new_figure(width=6.8, height=4.4)
    diagram = BifurcationDiagram.of(sweep, labelled=False, symbols=SYMBOLS)
    across, up = diagram.points("relative_velocity")
    axes.plot(across, up, markersize=0.7, rasterized=True, **_DOTS)
    axes.set_xlim(float(sweep.values[0]), float(sweep.values[-1]))
    axes.set_ylim(0.0, 1.05 * float(up.max()))
    network.plot(axes)
    with print_style():
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=7)
    return figure


def _at_motions(network: Network) -> Iterator[tuple[Branch, Bifurcation]]:
    for branch in network.branches:
        for bifurcation in branch.bifurcations:
            if bifurcation.admissible:
                yield branch, bifurcation


def _text(network: Network, compared: Sequence[Compared]) -> str:
    rows = [
        [
            branch.label,
            found.kind,
            f"{found.value:.10f}",
            "-" if found.multiplier is None else f"{complex(found.multiplier):.6g}",
            f"{found.error:.0e}",
        ]
        for branch, found in _at_motions(network)
    ]
    far = [entry for entry in compared if not (entry.distance <= _SAME and entry.stable)]
    others = ", ".join(f"{entry.label} at {entry.frequency:g}" for entry in far)
    cost = network.cost
    return (
        f"All P(1,m), m = 1 to {PERIODS}, and the P(2,m) that branch off them at period doublings "
        f"(PD) and grazing (GR) or that the sweep is at: {len(network)} branches, "
        f"{cost.counts['points']} points, in {cost.seconds:.1f} s; {network.message}. Stable "
        "orbits are solid, unstable ones dashed; dotted ones are no motions of the chain: the "
        "gap closes between their impacts, or an impulse pulls. Dots are the sweep of figure 4.\n\n"
        f"At every {_EVERY}th value of the sweep whose motion is P(1,m) or P(2,m), m up to "
        f"{PERIODS}, it went on until it had settled, for {_LONGER} impacts at most, and was "
        f"compared with the branches of its label: {len(compared) - len(far)} of {len(compared)} "
        f"are a stable orbit on one within {_SAME:g}{f'; not so {others}' if far else ''}.\n\n"
        "Bifurcations where a motion is or borders, branch by branch; the error is a bound "
        "of first order.\n\n" + table(["orbits", "kind", "frequency", "multiplier", "error"], rows)
    )


def _findings(network: Network, compared: Sequence[Compared]) -> list[Finding]:
    on = [entry.distance for entry in compared if entry.distance <= _SAME and entry.stable]
    counts = {
        kind: sum(found.kind == kind for _, found in _at_motions(network))
        for kind in ("SN", "PD", "NS", "GR")
    }
    errors = [found.error for _, found in _at_motions(network)]
    return [
        Finding(
            "motions of figure 4 on stable branches",
            "-",
            f"{len(on)} of {len(compared)}",
            f"{max(on, default=0.0):.0e}",
        ),
        Finding(
            "bifurcations of P(1,m) and P(2,m)",
            "-",
            ", ".join(f"{count} {kind}" for kind, count in counts.items()),
            f"{max(errors, default=0.0):.0e}",
        ),
    ]
