"""How much a run of the tests looks at: `HYPOTHESIS_PROFILE=thorough` looks at everything."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from typing import Any, Final, TypeVar
from unittest.mock import patch

from hypothesis import HealthCheck, settings

from dynkit.systems.impact.modes.taylor import chart as taylor_chart
from dynkit.systems.symbolic import flows
from dynkit.systems.symbolic.taylor import CODE

PLAIN: Final = "dynkit"
THOROUGH: Final = "thorough"

_Case = TypeVar("_Case")


def register_profiles() -> None:
    """Make the profile that `HYPOTHESIS_PROFILE` names the one of this run."""
    # The first example of a test may compile a kernel: neither a deadline nor a pace.
    plain = settings(
        deadline=None,
        derandomize=True,  # new examples are for the thorough profile
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.register_profile(PLAIN, plain)
    settings.register_profile(
        THOROUGH,
        plain,
        max_examples=3000,
        derandomize=False,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", PLAIN))


def is_thorough() -> bool:
    """Whether this run looks at everything."""
    return os.environ.get("HYPOTHESIS_PROFILE") == THOROUGH


def some(cases: Sequence[_Case], every: int) -> Sequence[_Case]:
    """Every so manieth of cases that check one property on one path, or all of them."""
    return cases if is_thorough() else cases[::every]


def share(part: float) -> settings:
    """Settings with a part of the profile's examples, for properties that cost more than others."""
    return settings(max_examples=max(round(part * settings().max_examples), 1))


def quick_code() -> None:
    """Compile Taylor's method without optimising it, which takes longer than most motions of tests.

    Tests of what users run take `optimised_code`.
    """
    if not is_thorough():
        CODE["opt_level"] = 0


@cache
def _kept_apart(owner: Any, *names: str) -> dict[str, Any]:
    """Functions of a module with caches of their own, which stay to the end."""
    return {name: lru_cache(None)(getattr(owner, name).__wrapped__) for name in names}


@contextmanager
def optimised_code() -> Iterator[None]:
    """Compile Taylor's method as for users, where oscillators are made anew."""
    charts = _kept_apart(taylor_chart, "_integrator", "_variations", "_gradients")
    with (
        patch.dict(CODE, {"opt_level": 3}),
        patch.multiple(taylor_chart, **charts),
        patch.multiple(flows, **_kept_apart(flows, "_taylor_of")),
    ):
        yield


@contextmanager
def shorter_searches(cells: int) -> Iterator[None]:
    """Searches for impacts give up after so many cells, unless this run looks at everything.

    Of motions that come to rest, or creep, a million cells show no more than some ten thousand.
    """
    from dynkit.systems.impact.simulation.runs import trajectory_of

    changed = {} if is_thorough() else {"most_cells": cells}
    with patch.dict(trajectory_of.__kwdefaults__, changed):
        yield
