"""Whether there is P(inf,4) beside P(inf,2): searches, and multipliers that could double."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.systems import ImpactChain, ImpactOrbit, ImpactState
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.arrays import Array
from tutorials.cusumano_bai_1993.resonances.branches import Ridge
from tutorials.cusumano_bai_1993.section import Finding, sentences, table

# Random starts of motions, impacts that they are given to settle, and that are kept.
_STARTS, _SETTLED, _KEPT = 20, 3000, 200
# Impacts until motions with little damping have settled.
_LONG = 30_000
# Orbits P(inf,m) are sought for these m where the paper reads P(inf,4); and that one at these
# parts of the branch, too.
_PERIODS = (1, 3, 4)
_SOUGHT, _ELSEWHERE = 4, (0.15, 0.85)
# Values at which the multipliers are looked at, one parameter after the other.
_OTHERS = {"restitution": (0.3, 0.5, 0.7, 0.9), "damping": (0.01, 0.03, 0.2, 0.3)}


class Sought(NamedTuple):
    """What a search for orbits that stick came to."""

    frequency: float
    periods: int
    orbits: list[ImpactOrbit]


class Multipliers(NamedTuple):
    """The multipliers of P(inf,m) with one parameter changed."""

    name: str
    value: float
    label: str
    multipliers: NDArray[np.complex128]


@dataclass(frozen=True)
class Shown:
    """What is shown of a motion that has not settled, as the paper made its pictures.

    Parameters
    ----------
    skipped, kept : float
        Table periods that the skipped impacts last, and the kept ones.
    two, four : (k,) array
        Distances of states two and four table periods apart, at phase zero after the skipped
        impacts, as long as the paper's series; relative to the largest coordinate.
    """

    skipped: float
    kept: float
    two: Array
    four: Array


def random_starts(chain: ImpactChain, count: int) -> list[ImpactState]:
    """Return states in random motion at random phases, always the same, small ones and large."""
    random = np.random.default_rng(0)
    found = []
    n = chain.degrees_of_freedom
    for _ in range(count):
        size, falling = 10.0 ** random.uniform(-1.5, 0.5), 1.0 / np.arange(1, n + 1)
        position = chain.modal_matrix @ (size * falling * random.normal(size=n))
        velocity = chain.modal_matrix @ (0.3 * size * falling * random.normal(size=n))
        position[-1] = abs(position[-1]) + 2.0 * chain.amplitude
        phase = float(random.uniform(0.0, 2.0 * np.pi))
        found.append(chain.state(position, velocity=velocity, phase=phase))
    return found


def labels_from(chain: ImpactChain, starts: list[ImpactState]) -> Counter[str]:
    """Return how often each label is what a start settles on."""
    return Counter(
        str(chain.attractor(transient=_SETTLED, impacts=_KEPT, start=start).label)
        for start in starts
    )


def searches(chain: ImpactChain, interval: tuple[float, float]) -> list[Sought]:
    """Return what searches for P(inf,m) find at the paper's frequency and within an interval."""
    low, high = interval
    places = [(paper.STICKING[0], m) for m in _PERIODS]
    places += [(low + share * (high - low), _SOUGHT) for share in _ELSEWHERE]
    return [
        Sought(
            frequency,
            m,
            chain.replace(frequency=frequency).periodic_orbits(sticking=True, periods=m),
        )
        for frequency, m in places
    ]


def multipliers_elsewhere(chain: ImpactChain) -> list[Multipliers]:
    """Return the multipliers of the settled motion, with one parameter changed."""
    found = []
    for name, values in _OTHERS.items():
        for value in values:
            changes: dict[str, float] = {name: value}
            motion = chain.replace(**changes).attractor(transient=_LONG, impacts=_KEPT)
            orbit = motion.periodic_orbit()
            found.append(Multipliers(name, value, orbit.label, orbit.multipliers))
    return found


def shown(chain: ImpactChain, periods: int) -> Shown:
    """Return what the impacts show that the paper keeps, and how well states come again."""
    period = 2.0 * np.pi / chain.frequency
    last = paper.TRANSIENT + paper.KEPT
    record = chain.simulate(impacts=3 * last)
    times = record.time / period
    first, count = np.ceil(times[paper.TRANSIENT]), int(paper.SHOWN[9].end / period)
    sections = (first + np.arange(count + 2 * periods)) * period
    states = np.concatenate(record.sample(sections), axis=1)
    two, four = (
        abs(states[step : count + step] - states[:count]).max(axis=1)
        for step in (periods, 2 * periods)
    )
    size = abs(states).max()
    return Shown(
        float(times[paper.TRANSIENT - 1]),
        float(times[last - 1] - times[paper.TRANSIENT - 1]),
        two / size,
        four / size,
    )


# --- in words ------------------------------------------------------------------------------------


def longer(chain: ImpactChain, second: Ridge) -> tuple[str, Finding]:
    """Return whether there is P(inf,4), and why the paper may have read it."""
    frequency, theirs = paper.STICKING
    low, high = (border.value for border in second.ends)
    sought = searches(chain, (low, high))
    starts = random_starts(chain, _STARTS)
    labels = labels_from(chain, starts)
    elsewhere = multipliers_elsewhere(chain)
    seen = shown(chain, second.periods)
    own = chain.attractor(transient=2000).periodic_orbit()
    slow = complex(own.multipliers[0])
    orbits = [str(orbit.label) for each in sought for orbit in each.orbits]
    settled = " and ".join(f"{label} {count} times" for label, count in labels.items())
    answer = f"Found near it: {', '.join(orbits)}."
    if not orbits:
        answer = f"None was found: the paper's seems to be {own.label}, not yet settled."
    text = (
        f"### {theirs} at {frequency}\n\n{answer} "
        + _tried(sought)
        + f"\n\n{len(starts)} motions from random starts at {frequency} settle on {settled}. "
        "A branch with twice the period leaves another where a multiplier passes -1. "
        + _doubling(second, elsewhere)
        + (
            "\n\nThe amplitude of the table only scales the motion, as the table's mean height is "
            "zero, and changes nothing of this."
            if chain.offset == 0.0
            else ""
        )
        + ("" if orbits else f"\n\n{what_was_seen(seen, slow, own.label, second.periods)}")
    )
    found = " and ".join(dict.fromkeys(orbits)) or "none"
    return text, Finding(
        f"orbit {theirs} near {frequency}",
        "seen",
        f"{found}; {settled} from random starts",
        f"{len(sought)} searches",
        bool(orbits),
    )


def what_was_seen(seen: Shown, slow: complex, label: str, periods: int) -> str:
    """Return what the paper may have seen instead of an orbit that is not found.

    Parameters
    ----------
    seen : Shown
    slow : complex
        The multiplier of the settled motion with the largest modulus.
    label : str
        Of the settled motion.
    periods : int
        Table periods in a period of it.
    """
    twice = 2 * periods
    better = int((seen.four < seen.two).sum())
    return sentences(
        f"What the paper may have seen: its {paper.TRANSIENT} skipped impacts last "
        f"{seen.skipped:.1f} table periods and the {paper.KEPT} that it keeps {seen.kept:.1f}"
        f"{f', less than one period of {twice}' if seen.kept < twice else ''}.",
        f"The slowest multipliers of {label} are {abs(slow):.4f} "
        f"exp(+-{abs(np.angle(slow)):.4f} i) in {periods} table periods, so that after the skipped "
        f"impacts {100.0 * abs(slow) ** (seen.skipped / periods):.0f} % of a slow disturbance are "
        "left.",
        f"In the {len(seen.two)} table periods after the skipped impacts, states at phase zero "
        f"that are {periods} table periods apart differ by up to {100.0 * seen.two.max():.1g} % of "
        f"the largest coordinate, those {twice} apart by up to {100.0 * seen.four.max():.1g} %, "
        f"and {better} of them return better after {twice} than after {periods}.",
        f"As many points as {twice} periods have are then no sign of that period."
        if better < len(seen.two)
        else "",
        "What length of motion the paper's spectrum was taken from is not known, and its lines of "
        f"period {twice} stay unexplained.",
    )


def _tried(sought: Sequence[Sought]) -> str:
    rows = [
        [
            f"{each.frequency:.5f}",
            f"P(inf,{each.periods})",
            " and ".join(orbit.label for orbit in each.orbits) or "none",
        ]
        for each in sought
    ]
    return (
        "Newton's method, from releases of structures in random motion on the table and of the "
        "motion from the default start:\n\n" + table(["frequency", "sought", "found"], rows)
    )


def _doubling(second: Ridge, elsewhere: Sequence[Multipliers]) -> str:
    along = float(_most_negative(second.branch.multipliers))
    doubled = [border for border in second.branch.bifurcations if border.kind == "PD"]
    rows = [
        [
            f"{each.name} {each.value:g}",
            each.label,
            f"{abs(each.multipliers[0]):.4f}",
            f"{float(_most_negative(each.multipliers)):.4f}",
        ]
        for each in elsewhere
    ]
    verdict = (
        "None does along the branch in frequency"
        if not doubled
        else f"That happens at {', '.join(f'{border.value:.6f}' for border in doubled)}"
    )
    return (
        f"{verdict}; the multiplier furthest to the left has a real part of {along:.4f}. "
        f"{about_doubling([_most_negative(each.multipliers) for each in elsewhere])}:\n\n"
        + table(["changed", "motion", "largest modulus", "least real part of a multiplier"], rows)
    )


def about_doubling(least: Sequence[float]) -> str:
    """Return how many motions with another parameter have a multiplier beyond -1.

    Parameters
    ----------
    least : sequence of float
        The least real part of the multipliers of each.
    """
    beyond = sum(each <= -1.0 for each in least)
    words = f"at {paper.STICKING[0]} with other restitution or damping"
    if not beyond:
        return f"None comes to -1 {words}, at these values"
    return f"{beyond} of these motions {words} have one at or beyond -1"


def _most_negative(multipliers: NDArray[np.complex128]) -> float:
    return float(multipliers.real.min())
