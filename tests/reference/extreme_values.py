"""Writes the exact values of the extreme cases: 30 digits of impacts of the extreme campaign.

python -m tests.reference.extreme_values
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import mpmath
from mpmath import mp, mpf

from tests.reference.extreme_campaign import Extreme, extremes
from tests.reference.general_oscillator import BITS, History, Impact

FILE: Final = Path(__file__).parents[1] / "benchmarks" / "extremes" / "cases.json"
DIGITS: Final = 30
LARGEST: Final = 10
"""Coordinates are written of so many masses at most."""

ISOLATED: Final = 1e-3
"""Impacts are compared that are so far from those beside them, as a part of the mean distance."""

ENDINGS: Final = {
    "count": "COUNT_REACHED",
    "no further contact": "NO_FURTHER_CONTACT",
    "contact for ever": "CONTACT_FOR_EVER",
}
ABOUT: Final = (
    "Extreme cases of impact oscillators and their exact impacts, written by "
    "tests/reference/extreme_values.py. Numbers of systems and starts are doubles; those of "
    f"impacts have {DIGITS} digits, from proved roots in 50-digit arithmetic. A state is that of "
    "the section: positions and velocities without those of the contact coordinate, relative "
    "velocity, phase."
)


def values_of(extreme: Extreme) -> dict[str, Any]:
    """The entry of a case, with its exact values computed anew."""
    entry, history = extreme.entry, extreme.simulate()
    contact = entry["system"]["arguments"].get("contact", -1)
    n = len(history.impacts[0].position) if history.impacts else 0
    kept = _kept(n)
    impacts = [
        {"after": after, "number": number, **_written(history.impacts[i], contact, kept)}
        for i, after, number in _chosen(history, on_table="section" in entry["start"])
    ]
    coordinates = {} if len(kept) == 2 * n else {"coordinates": kept}
    return {**entry, "ending": ENDINGS[history.ending], **coordinates, "values": impacts}


def write(path: Path = FILE) -> None:
    """Write the file, one case a line."""
    lines = [json.dumps(values_of(extreme)) for extreme in extremes()]
    cases = ",\n".join(lines)
    path.write_text(f'{{"about": {json.dumps(ABOUT)},\n"cases": [\n{cases}\n]}}\n')


# --- what is written of a motion ------------------------------------------------------------------


def _chosen(history: History, *, on_table: bool) -> list[tuple[int, int, int]]:
    """Some impacts, the last one too: place, releases before, number since the last of them.

    None in the depth of a chatter, which a simulation may replace by contact.
    """
    times = [impact.time for impact in history.impacts]
    releases = [contact.release for contact in history.contacts if contact.release != mpmath.inf]
    if not times:
        return []
    events = [mpf(0), *times, *releases]
    mean = max(events) / len(times)
    found = []
    for i, time in enumerate(times):
        after = sum(release <= time for release in releases)
        begin = releases[after - 1] if after else mpf(0)
        number = sum(begin <= earlier < time for earlier in times)
        before = times[i - 1] if i else mpf(0) if on_table else -mpmath.inf
        before = max(before, begin) if after else before
        if time - before > ISOLATED * mean or not history.contacts:
            found.append((i, after, number))
    middle = found[len(found) // 2]
    return sorted({found[0], middle, found[-1]})


def _kept(n: int) -> list[int]:
    """Section coordinates that are written."""
    others = [round(k * (n - 2) / (LARGEST - 1)) for k in range(LARGEST)] if n > LARGEST else []
    masses = others or range(n - 1)
    return [*masses, *(n - 1 + i for i in masses), 2 * n - 2, 2 * n - 1]


def _written(impact: Impact, contact: int, kept: list[int]) -> dict[str, Any]:
    n = len(impact.position)
    others = [i for i in range(n) if i != contact % n]
    sign = -1 if impact.side == "far" else 1
    with mp.workprec(BITS):
        state = [impact.position[i] for i in others] + [impact.velocity[i] for i in others]
        state += [sign * impact.relative_velocity, _phase(impact.phase)]
        return {
            "time": mpmath.nstr(impact.time, DIGITS),
            "state": [mpmath.nstr(state[i], DIGITS) for i in kept],
        }


def _phase(phase: Any) -> Any:
    """Within one turn; zero where only rounding keeps it from a whole number of turns."""
    turns = phase / (2 * mp.pi)
    return mpf(0) if abs(turns - mpmath.nint(turns)) < mpf("1e-150") else phase % (2 * mp.pi)


if __name__ == "__main__":
    write()
