"""Chaos that ends: long runs from several starts, and how far each is chaotic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynkit import OrbitLabel
from dynkit.systems import ImpactChain, ImpactState
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.arrays import Array
from tutorials.cusumano_bai_1993.measures.starts import starts
from tutorials.cusumano_bai_1993.settling import impacts_until_settled

VERY_LONG = 60_000
"""Impacts of a run in which a motion that settles late has settled."""

# A motion that recurs this well, relative, for good is on its way to the periodic one.
_CAUGHT = 1e-2


@dataclass(frozen=True, eq=False)
class LongRun:
    """A run that is chaotic at first and may settle.

    It begins after the impacts that the paper skips, in a section state: what follows that state is
    the same motion, to the last bit.

    Parameters
    ----------
    state : (2N,) array
        Where it begins, in the section.
    label : OrbitLabel
        After all its impacts.
    settled : int or None
        Impacts after which it recurs for good; None when it does not.
    chaotic : int
        Impacts before it is caught by the periodic motion; all when it is not.
    states : (chaotic, 2N) array
        Section states of its chaos.
    """

    state: Array
    label: OrbitLabel
    settled: int | None
    chaotic: int
    states: Array


def long_runs(chain: ImpactChain) -> list[LongRun]:
    """Return a run from each start."""
    return [_long_run(chain, start) for start in starts(chain)]


def which_chaos(runs: Sequence[LongRun]) -> str:
    """Return of which chaos the longest of these runs is."""
    ended = sum(run.settled is not None for run in runs)
    if not ended:
        return f"chaos that goes on to the end of all {len(runs)} runs"
    return f"the chaos before it ends, as it does in {ended} of {len(runs)} runs"


def _long_run(chain: ImpactChain, start: ImpactState) -> LongRun:
    state = chain.attractor(transient=paper.TRANSIENT, impacts=1, start=start).states[0]
    record = chain.simulate(impacts=VERY_LONG, start=chain.impact_state(state))
    label = chain.attractor(transient=0, start=record.final).label
    settled, chaotic = None, len(record)
    if label.iterates is not None:
        settled = impacts_until_settled(record, label.iterates)
        caught = impacts_until_settled(record, label.iterates, within=_CAUGHT)
        chaotic = len(record) if caught is None else caught
    return LongRun(state, label, settled, chaotic, record.states[:chaotic].copy())
