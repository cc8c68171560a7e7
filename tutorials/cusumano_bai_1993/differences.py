"""Statements of the paper that others contradict: each looked into by runs of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dynkit import OrbitKind, OrbitLabel
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.frequencies import closed_form
from tutorials.cusumano_bai_1993.measures.starts import named, starts
from tutorials.cusumano_bai_1993.measures.transient import VERY_LONG
from tutorials.cusumano_bai_1993.section import LOOKED_INTO, Finding, Section, sentences, table
from tutorials.cusumano_bai_1993.settling import (
    FAR,
    NEAR,
    RECURS,
    Settling,
    impacts_until_parted,
    settling_of,
)
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

# Cuts of the chatter: the change of the state that it may make.
_CUTS = (1e-16, 1e-12, 1e-8)
# Impacts after which a settled motion is looked at.
_LONG = 5000
# A distance from the periodic motion, relative, that a figure shows: a part of its height.
_VISIBLE = 1e-3


@dataclass(frozen=True)
class _Run:
    """One run, and the label that it came to."""

    cells: tuple[str, ...]
    label: OrbitLabel


class _Looked(NamedTuple):
    """What is said of a statement of the paper, and whether it holds."""

    text: str
    finding: Finding
    holds: bool


def differences(workshop: Workshop) -> Section:
    """Look into what the paper says otherwise."""
    watch = Stopwatch()
    parts, findings, apart = [], [], []
    for name, look in (
        ("first frequency", _first_frequency),
        ("sticking", _sticking),
        ("long period", _long_period),
        ("chaos of Table 1", _chaos_of_table_1),
        ("transient chaos", _transient_chaos),
    ):
        with watch.time(name):
            text, finding, holds = look(workshop)
        parts.append(text)
        findings.append(replace(finding, agrees=holds))
        apart += [] if holds else [finding.what]
    return Section(
        "differences",
        LOOKED_INTO,
        "\n\n".join([verdict(len(parts), apart), *parts]),
        findings,
        seconds=watch.seconds,
    )


def verdict(count: int, apart: Sequence[str]) -> str:
    """Return how many of so many statements do not hold, and which."""
    if not apart:
        return f"All {count} statements of the paper that are looked into here hold."
    return (
        f"Of {count} statements of the paper that are looked into here {len(apart)} "
        f"{'does' if len(apart) == 1 else 'do'} not hold: {', '.join(apart)}."
    )


def _first_frequency(workshop: Workshop) -> _Looked:
    ours = float(workshop.chain(paper.FREQUENCIES[0]).natural_frequencies[0])
    theirs = paper.NATURAL_FREQUENCIES[0]
    # two numbers that agree to the last bit may both be wrong by half of it
    error = max(abs(ours - closed_form(1, paper.MASSES)), float(np.spacing(ours)))
    text = (
        f"### The first natural frequency\n\nIt is {ours:.5f}, which rounds to {ours:.3f}; the "
        f"paper's Table A1 gives {theirs:.3f}. The closed form is within {error:.0e} of it."
    )
    finding = Finding("first natural frequency", f"{theirs:.3f}", f"{ours:.5f}", f"{error:.0e}")
    return _Looked(text, finding, f"{ours:.3f}" == f"{theirs:.3f}")


def _run_table(heads: Sequence[str], runs: Sequence[_Run]) -> str:
    return table(
        [*heads, "label", "recurrence", "impacts"],
        [
            [*run.cells, run.label, f"{run.label.recurrence:.0e}", run.label.simulated]
            for run in runs
        ],
    )


def _found(runs: Sequence[_Run]) -> str:
    return " and ".join(dict.fromkeys(str(run.label) for run in runs))


def _recurrence(runs: Sequence[_Run]) -> str:
    return f"recurrence {max(run.label.recurrence for run in runs):.0e}"


def _sticking(workshop: Workshop) -> _Looked:
    frequency, theirs = paper.STICKING
    chain = workshop.chain(frequency)
    runs = [
        _Run(
            (named(number), f"{cut:.0e}"),
            chain.replace(chatter_tolerance=cut).attractor(start=start).label,
        )
        for number, start in enumerate(starts(chain, 5))
        for cut in (_CUTS if number == 0 else _CUTS[:1])
    ]
    # a single state of a sweep that the paper made in the same way
    followed = chain.attractor(start=workshop.state_before(frequency)).label
    runs.append(_Run(("along the sweep of figure 4", f"{chain.chatter_tolerance:.0e}"), followed))
    found = _found(runs)
    periods = runs[0].label.periods
    settling = (
        settling_of(chain.simulate(impacts=_LONG), periods=periods)
        if periods is not None and runs[0].label.kind is OrbitKind.STICKING
        else None
    )
    holds = all(paper.agrees(theirs, str(run.label)) for run in runs)
    text = (
        f"### Frequency {frequency}: the paper {theirs}, found {found}\n\n"
        f"Labels after {paper.TRANSIENT} skipped impacts, from the impacts in the last column. The "
        "cut is the change of the state that replacing the rest of a chatter by contact may make. "
        "Recurrence is the distance of states one period apart, relative to the largest state.\n\n"
        + _run_table(["start", "cut"], runs)
        + ("" if settling is None else f"\n\n{about_settling(settling, holds=holds)}")
    )
    finding = Finding(
        f"motion at {frequency}", theirs, f"{found} in {len(runs)} runs", _recurrence(runs)
    )
    return _Looked(text, finding, holds)


def about_settling(settling: Settling, *, holds: bool) -> str:
    """Return how a motion settles, and whether the paper saw it settled.

    Parameters
    ----------
    settling : Settling
    holds : bool
        Whether the motion is the one that the paper reads.
    """
    last = paper.TRANSIENT + paper.KEPT
    rows = [
        [count, f"{settling.table_periods(count):.1f}", f"{settling.distance(count):.1e}"]
        for count in (paper.TRANSIENT, last, 1400, 2000, 3000)
    ]
    left = settling.distance(last)
    if left <= _VISIBLE:
        seen = f"So what {last} impacts show is settled, as far as a figure shows it"
    else:
        seen = f"So what {last} impacts show is not settled yet"
        seen += "" if holds else ", which may be why the paper reads another motion"
    return (
        f"From one sticking event to the next, {settling.turns:.3g} table periods later, there are "
        f"{settling.impacts:.0f} impacts, on average. The {last} impacts that the paper simulates "
        f"at one frequency, {paper.TRANSIENT} of them skipped, hold {settling.events(last)} "
        f"sticking events from the paper's start. {settling.periods} table periods multiply the "
        f"distance to the periodic motion by a factor {settling.ratio:.3f} on average (fitted to "
        f"{settling.count} events). {seen}:\n\n"
        + table(["impacts", "table periods", "distance to the periodic motion, relative"], rows)
    )


def _long_period(workshop: Workshop) -> _Looked:
    frequency, theirs = paper.LONG_PERIOD
    chain = workshop.chain(frequency)
    runs = [
        _Run(
            (named(number), str(transient)),
            chain.attractor(transient=transient, start=start).label,
        )
        for number, start in enumerate(starts(chain, 3))
        for transient in (paper.TRANSIENT, _LONG)
    ]
    text = (
        f"### Frequency {frequency}: the paper {theirs}, found {_found(runs)}\n\nTable 1 of the "
        "paper leaves the number of impacts open.\n\n" + _run_table(["start", "skipped"], runs)
    )
    finding = Finding(f"motion at {frequency}", theirs, _found(runs), _recurrence(runs))
    return _Looked(text, finding, all(paper.agrees(theirs, str(run.label)) for run in runs))


def _chaos_of_table_1(workshop: Workshop) -> _Looked:
    listed, written = (
        [
            _Run(
                (f"{frequency}", named(number)),
                workshop.chain(frequency).attractor(transient=_LONG, start=start).label,
            )
            for number, start in enumerate(starts(workshop.chain(frequency), 3))
        ]
        for frequency in (paper.TABLE_1_CHAOS, paper.TEXT_CHAOS)
    )
    text = (
        f"### Frequency {paper.TABLE_1_CHAOS}: the paper chaos, found {_found(listed)}\n\n"
        f"Table 1 of the paper lists chaos at {paper.TABLE_1_CHAOS}, its text speaks of "
        f"{paper.TEXT_CHAOS}; there the motion is {_found(written)}. After {_LONG} skipped "
        "impacts:\n\n" + _run_table(["frequency", "start"], [*listed, *written])
    )
    finding = Finding(
        f"motion at {paper.TABLE_1_CHAOS}",
        "chaotic (Table 1)",
        f"{_found(listed)}; at {paper.TEXT_CHAOS} {_found(written)}",
        _recurrence(listed),
    )
    return _Looked(text, finding, all(run.label.kind is OrbitKind.CHAOTIC for run in listed))


def _transient_chaos(workshop: Workshop) -> _Looked:
    chain = workshop.chain(paper.CHAOS)
    runs: list[_Run] = []
    waits: list[int] = []
    for number, long in enumerate(workshop.long_runs):
        attractor = chain.attractor(transient=0, start=chain.impact_state(long.state))
        parted = impacts_until_parted(chain, attractor.final)
        if long.settled is not None:
            waits.append(long.settled)
        cells = (
            named(number),
            str(attractor.label),
            "never" if parted is None else str(parted),
            "not settled" if long.settled is None else str(long.settled),
        )
        runs.append(_Run(cells, long.label))
    ended = [long.settled is not None for long in workshop.long_runs]
    found = _found([run for run, end in zip(runs, ended, strict=True) if end]) or "the same"
    text = (
        f"### Frequency {paper.CHAOS}: the paper chaos, found {found} in the end\n\n"
        f"{about_chaos(len(runs), waits, found)} The "
        f"third column says how many impacts after the first {paper.TRANSIENT + paper.KEPT} two "
        f"motions that begin {NEAR:g} apart need to be {FAR:g} apart. The label after "
        f"{paper.TRANSIENT} impacts looks ahead, up to 20000 impacts, and says `unsettled` where "
        "the motion changes its kind on the way. Settled is a motion that from then on recurs to "
        f"{RECURS:g} of its size after each period.\n\n"
        + _run_table(
            ["start", f"label after {paper.TRANSIENT}", "impacts to part", "impacts to settle"],
            runs,
        )
    )
    words = f"chaotic in {len(runs)} runs"
    if waits:
        words = f"{found} in {len(waits)} of {len(runs)} runs, after {min(waits)} to {max(waits)} impacts"
    finding = Finding(f"motion at {paper.CHAOS}", "chaotic", words, _recurrence(runs))
    return _Looked(text, finding, not waits)


def about_chaos(count: int, waits: Sequence[int], found: str) -> str:
    """Return how many of so many long runs settled, after how many impacts, and on what."""
    begun = f"Of {count} runs of {VERY_LONG} impacts, besides the first {paper.TRANSIENT}, "
    if not waits:
        return f"{begun}none settled."
    return sentences(
        f"{begun}{len(waits)} settled, on {found}, after {min(waits)} to {max(waits)} impacts.",
        "So the chaos that the paper shows is a long transient."
        if len(waits) == count
        else f"So the chaos that the paper shows ends in these {len(waits)}.",
        "When it settles depends on rounding: another machine may find other numbers of impacts.",
    )
