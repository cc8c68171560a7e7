"""The standard jobs, and their exact impacts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynkit.analysis.work_precision.exact import ExactImpacts

JOBS = {
    "periodic": "P(1,3), 10 impacts",
    "chaos": "chaos, 30 impacts",
    "chatter": "chatter and sticking, twice",
    "damping": "damping 1e4",
    "stiffness": "stiffness ratio 1e8",
    "size": "N = 100",
    "grazing": "200 near-grazing starts",
}
"""Names for the command line, and what stands in tables and above figures."""


def standard_jobs(names: Sequence[str] | None = None) -> dict[str, list[ExactImpacts]]:
    """Return the jobs for `dynkit.analysis.WorkPrecision`, by what stands in tables.

    Parameters
    ----------
    names : sequence of str, optional
        Some of `JOBS`; by default all.

    Raises
    ------
    ValueError
        When a name is unknown.
    """
    for name in names or ():
        if name not in JOBS:
            raise ValueError(f"only must hold jobs among {', '.join(JOBS)}; got {name!r}")
    found: dict[str, list[ExactImpacts]] = {
        title: [] for name, title in JOBS.items() if names is None or name in names
    }
    for entry in read_starts():
        title = JOBS[entry["job"]]
        if title in found:
            found[title].append(exact_impacts(entry))
    return found


def read_starts() -> list[dict[str, Any]]:
    """Read the starts, as they are written."""
    text = Path(__file__).with_name("jobs.json").read_text(encoding="utf-8")
    starts: list[dict[str, Any]] = json.loads(text)["starts"]
    return starts


def exact_impacts(entry: dict[str, Any]) -> ExactImpacts:
    """Make a start and its exact impacts from what is written."""
    from dynkit.analysis.work_precision.exact import ExactImpacts
    from dynkit.systems.impact.oscillators.chain import ImpactChain

    own = {name: value for name, value in entry.items() if name not in ("job", "system")}
    return ExactImpacts(system=ImpactChain(**entry["system"]), **own)
