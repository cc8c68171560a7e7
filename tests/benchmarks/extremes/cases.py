"""The extreme cases: what is simulated, and the exact impacts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
    from dynkit.systems.impact.simulation.state import ImpactState

GROUPS = (
    "restitution",
    "damping",
    "ratios",
    "size",
    "frequency",
    "resonance",
    "merging",
    "table",
    "start",
    "time",
    "long",
)


@dataclass(frozen=True)
class ExactImpact:
    """One impact to 30 digits.

    Parameters
    ----------
    after, number : int
        How many releases came before it, and how many impacts since the last of them.
    time : Decimal
    state : tuple of Decimal
        Section coordinates just after it, or some of them.
    """

    after: int
    number: int
    time: Decimal
    state: tuple[Decimal, ...]


@dataclass(frozen=True)
class Case:
    """One case.

    Parameters
    ----------
    group, name : str
    kind : {"ImpactChain", "MatrixOscillator"}
    arguments, start : mapping
        Of the system, and of its `state`; or the ``section`` coordinates to start from.
    transient, impacts : int
        To skip, and to keep.
    ending : str
        Name of the ending of the exact motion.
    coordinates : tuple of int
        Of which section coordinates there are exact values; none for all.
    values : tuple of ExactImpact
    """

    group: str
    name: str
    kind: str
    arguments: dict[str, Any]
    start: dict[str, Any]
    transient: int
    impacts: int
    ending: str
    coordinates: tuple[int, ...]
    values: tuple[ExactImpact, ...]

    def system(self) -> ImpactOscillator:
        """Make the oscillator."""
        from dynkit.systems.impact.oscillators.chain import ImpactChain
        from dynkit.systems.impact.oscillators.matrix import MatrixOscillator

        arguments = dict(self.arguments)
        if "harmonic_forces" in arguments:
            arguments["harmonic_forces"] = [complex(*f) for f in arguments["harmonic_forces"]]
        kind: Any = ImpactChain if self.kind == "ImpactChain" else MatrixOscillator
        oscillator: ImpactOscillator = kind(**arguments)
        return oscillator

    def begin(self, oscillator: ImpactOscillator) -> ImpactState:
        """Return the state to start from."""
        if "section" in self.start:
            import numpy as np

            return oscillator.impact_state(np.array(self.start["section"]))
        return oscillator.state(**self.start)


def read_cases() -> list[Case]:
    """Read the cases."""
    text = Path(__file__).with_name("cases.json").read_text(encoding="utf-8")
    return [_case(entry) for entry in json.loads(text)["cases"]]


def _case(entry: dict[str, Any]) -> Case:
    return Case(
        entry["group"],
        entry["name"],
        entry["system"]["kind"],
        entry["system"]["arguments"],
        entry["start"],
        entry.get("transient", 0),
        entry["impacts"],
        entry["ending"],
        tuple(entry.get("coordinates", ())),
        tuple(
            ExactImpact(
                value["after"],
                value["number"],
                Decimal(value["time"]),
                tuple(map(Decimal, value["state"])),
            )
            for value in entry["values"]
        ),
    )
