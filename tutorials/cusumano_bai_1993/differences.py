"""Where the paper does not hold: each point looked into by runs of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynkit import OrbitLabel
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.frequencies import closed_form
from tutorials.cusumano_bai_1993.measures.starts import named, starts
from tutorials.cusumano_bai_1993.measures.transient import VERY_LONG
from tutorials.cusumano_bai_1993.section import Finding, Section, table
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


@dataclass(frozen=True)
class _Run:
    """One run, and the label that it came to."""

    cells: tuple[str, ...]
    label: OrbitLabel


def differences(workshop: Workshop) -> Section:
    """Look into what the paper says otherwise."""
    watch = Stopwatch()
    parts, findings = [], []
    for name, look in (
        ("first frequency", _first_frequency),
        ("sticking", _sticking),
        ("long period", _long_period),
        ("chaos of Table 1", _chaos_of_table_1),
        ("transient chaos", _transient_chaos),
    ):
        with watch.time(name):
            text, finding = look(workshop)
        parts.append(text)
        findings.append(finding)
    return Section(
        "differences",
        "Where the paper does not hold",
        "\n\n".join(parts),
        findings,
        seconds=watch.seconds,
    )


def _first_frequency(workshop: Workshop) -> tuple[str, Finding]:
    ours = float(workshop.chain(paper.FREQUENCIES[0]).natural_frequencies[0])
    theirs = paper.NATURAL_FREQUENCIES[0]
    # two numbers that agree to the last bit may both be wrong by half of it
    error = max(abs(ours - closed_form(1, paper.MASSES)), float(np.spacing(ours)))
    text = (
        f"### The first natural frequency\n\nIt is {ours:.5f}, which rounds to {ours:.3f}; the "
        f"paper's Table A1 gives {theirs:.3f}. The closed form confirms it to {error:.0e}."
    )
    return text, Finding("first natural frequency", f"{theirs:.3f}", f"{ours:.5f}", f"{error:.0e}")


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


def _sticking(workshop: Workshop) -> tuple[str, Finding]:
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
    settling = settling_of(chain.simulate(impacts=_LONG), periods=2)
    text = (
        f"### Frequency {frequency}: the paper {theirs}, found {found}\n\n"
        f"Labels after {paper.TRANSIENT} skipped impacts, from the impacts in the last column. The "
        "cut is the change of the state that replacing the rest of a chatter by contact may make. "
        "Recurrence is the distance of states one period apart, relative to the largest state.\n\n"
        + _run_table(["start", "cut"], runs)
        + "\n\n"
        + _about_settling(settling)
    )
    return text, Finding(
        f"motion at {frequency}", theirs, f"{found} in {len(runs)} runs", _recurrence(runs)
    )


def _about_settling(settling: Settling) -> str:
    last = paper.TRANSIENT + paper.KEPT
    rows = [
        [count, f"{settling.table_periods(count):.1f}", f"{settling.distance(count):.1e}"]
        for count in (paper.TRANSIENT, last, 1400, 2000, 3000)
    ]
    return (
        f"From one sticking event to the next, two table periods later, there are "
        f"{settling.impacts:.0f} impacts. The {last} impacts that the paper simulates at one "
        f"frequency, {paper.TRANSIENT} of them skipped, hold {settling.events(last)} sticking "
        f"events from the paper's start. The motion settles slowly: two table periods bring it "
        f"nearer to the periodic one by a factor {settling.ratio:.3f} on average (fitted to "
        f"{settling.count} events). So what {last} impacts show is not settled yet, which may be "
        "why the paper reads a longer period:\n\n"
        + table(["impacts", "table periods", "distance to the periodic motion, relative"], rows)
    )


def _long_period(workshop: Workshop) -> tuple[str, Finding]:
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
    return text, Finding(f"motion at {frequency}", theirs, _found(runs), _recurrence(runs))


def _chaos_of_table_1(workshop: Workshop) -> tuple[str, Finding]:
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
    return text, Finding(
        f"motion at {paper.TABLE_1_CHAOS}",
        "chaotic (Table 1)",
        f"{_found(listed)}; at {paper.TEXT_CHAOS} {_found(written)}",
        _recurrence(listed),
    )


def _transient_chaos(workshop: Workshop) -> tuple[str, Finding]:
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
    periodic = [run for run in runs if run.label.impacts is not None]
    found = _found(periodic) or "nothing periodic"
    span = f"{min(waits)} to {max(waits)}" if waits else "none"
    text = (
        f"### Frequency {paper.CHAOS}: the paper chaos, found {found} in the end\n\n"
        f"Of {len(runs)} runs of {VERY_LONG} impacts, besides the first {paper.TRANSIENT}, "
        f"{len(waits)} settled, on {found}, after {span} impacts. Before that nearby "
        "motions part: the "
        f"third column says how many impacts after the first {paper.TRANSIENT + paper.KEPT} two "
        f"motions that begin {NEAR:g} apart need to be {FAR:g} apart. The label after "
        f"{paper.TRANSIENT} impacts looks ahead, up to 20000 impacts, and says `unsettled` where "
        "the motion changes its kind on the way. So the chaos that the paper shows is a long "
        f"transient. Settled is a motion that from then on recurs to {RECURS:g} of its size after "
        "each period. When it settles depends on rounding: another machine may find other numbers "
        "of impacts.\n\n"
        + _run_table(
            ["start", f"label after {paper.TRANSIENT}", "impacts to part", "impacts to settle"],
            runs,
        )
    )
    return text, Finding(
        f"motion at {paper.CHAOS}",
        "chaotic",
        f"{found} in {len(waits)} of {len(runs)} runs, after {span} impacts",
        _recurrence(runs),
    )
