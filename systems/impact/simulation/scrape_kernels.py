"""Kernels of friction at impacts: Coulomb's law for the impulse, and the tail of a chatter.

An impact that changes the rate of the gap by J takes `ratio` J from the slip velocity w at most,
ratio = mu A_tt / A_nn with A = J M^-1 J', and no more than brings w to zero. Slip velocity and gap
must not be coupled by the masses, A_nt = 0.
"""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import FOUND, START
from dynkit.systems.impact.simulation.clock_kernels import FLIGHT, MOTION, STILL
from dynkit.systems.impact.simulation.contact_kernels import SMALLEST, Tables
from dynkit.systems.impact.simulation.event_kernels import add_jump, copy

_SAFE = 0.25
"""Part of what decides between slip and stick by which a tail must be clear of the border."""

_STILL = 1e-6
"""A slip velocity below this part of what an impact may take from it is zero."""


@kernel()
def _slip(tables: Tables, g: int, f: int, states: Array, order: int) -> float:
    """The slip velocity of friction `f` at guard `g`, or with order 1 its rate in flight."""
    rows = tables.scrape[g, f]
    total = tables.scraped[g, f, 1] if order == 0 else 0.0
    for i in range(rows.shape[1]):
        total += rows[2 * order, i] * states[START, 0, i]
        total += rows[2 * order + 1, i] * states[START, 1, i]
    return total


@kernel()
def _change(
    tables: Tables, g: int, f: int, change: float, stops: bool, left: Array, states: Array
) -> None:
    """Change a slip velocity; the start state is modified in place, and FOUND is lost."""
    copy(states, START, FOUND)
    add_jump(tables.scrape[g, f, 4:], change, states)
    left[int(tables.scraped[g, f, 2]), MOTION] = STILL if stops else FLIGHT


@kernel(entry=True)
def taken(w: float, most: float) -> tuple[float, bool]:
    """Change of a slip velocity by an impact that takes so much at most; whether that is all."""
    stops = abs(w) <= most
    return -w if stops else -math.copysign(most, w), stops


@kernel()
def scrape(tables: Tables, g: int, jump: float, left: Array, states: Array) -> None:
    """Friction at an impact that has changed the rate of the gap by `jump`; in place."""
    for f in range(tables.scraped.shape[1]):
        most = tables.scraped[g, f, 0] * jump
        if most > 0.0:
            change, stops = taken(_slip(tables, g, f, states, 0), most)
            _change(tables, g, f, change, stops, left, states)


@kernel(entry=True)
def tail(
    ratio: float, w: float, pull: float, r: float, u: float, second: float, tolerance: float
) -> tuple[bool, bool, float, float]:
    """Whether friction slips, or sticks, throughout the bounces from relative velocity `u` on.

    Then whether it sticks, by how much w changes as contact takes their place, and the error of
    places by that. In flight w changes at the rate `pull`, and that of the gap at `second`.

    Bounce i leaves at u r^i, takes 2 u r^i/a and ends with an impulse of (1 + r) u r^i. Contact has
    the impulse of a over the same time, which is more by u in the sum: slip gets that back. What
    sticks moves in each flight and is stopped at its end.
    """
    a = -second
    flight, takes = 2.0 * abs(pull) / a, ratio * (1.0 + r)
    margin = _SAFE * (flight + takes) * u / (1.0 - r)
    for sign in (1.0, -1.0):
        along = flight if sign * pull > 0.0 else -flight
        begins, ends = sign * w, sign * w + (along - takes) * u / (1.0 - r)
        if begins >= -_STILL * takes * u and ends > margin:
            return True, False, sign * ratio * u, 0.0
    moved = (abs(w) + flight * u) * (2.0 * u / a) / (1.0 - r * r)
    stuck = abs(w) + (1.0 + _SAFE) * flight * u <= (1.0 - _SAFE) * takes * u
    return stuck and (moved <= tolerance or u <= SMALLEST), True, -w, moved


@kernel()
def _tail(
    tables: Tables, g: int, f: int, r: float, u: float, second: float, states: Array
) -> tuple[bool, bool, float, float]:
    w, pull = _slip(tables, g, f, states, 0), _slip(tables, g, f, states, 1)
    return tail(tables.scraped[g, f, 0], w, pull, r, u, second, tables.tolerance)


@kernel()
def scrapes_out(
    tables: Tables, g: int, r: float, u: float, second: float, left: Array, states: Array
) -> tuple[bool, float]:
    """Whether all friction at guard `g` has a `_tail`; then slip is changed, in place. Its error.

    As contact begins what is left of the slip velocity is that of contact.
    """
    error = 0.0
    for f in range(tables.scraped.shape[1]):
        if tables.scraped[g, f, 0] > 0.0:
            known, _, _, moved = _tail(tables, g, f, r, u, second, states)
            if not known:
                return False, 0.0
            error += moved
    for f in range(tables.scraped.shape[1]):
        if tables.scraped[g, f, 0] > 0.0:
            _, stops, change, _ = _tail(tables, g, f, r, u, second, states)
            _change(tables, g, f, change, stops, left, states)
    return True, error
