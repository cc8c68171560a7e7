"""Kernels of friction at impacts: Coulomb's law for the impulse, and the tail of a chatter.

An impact changes the rate of the gap by a jump j. Its friction changes the slip velocity w towards
zero by ``ratio * j``, or by |w| if that is less. Here ratio = mu A_tt / A_nn with A = J M^-1 J'.
Slip velocity and gap must not be coupled by the masses: A_nt = 0.
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
"""Relative distance that the tail of a chatter must have from the border of slip and stick."""

_STILL = 1e-6
"""A slip velocity counts as zero below this part of the largest change of it by an impact."""


@kernel()
def _slip(tables: Tables, g: int, f: int, states: Array, order: int) -> float:
    """The slip velocity of friction `f` at guard `g`; with order 1, its rate in flight."""
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
    """Change a slip velocity; modifies the start state in place and overwrites the found state."""
    copy(states, START, FOUND)
    add_jump(tables.scrape[g, f, 4:], change, states)
    left[int(tables.scraped[g, f, 2]), MOTION] = STILL if stops else FLIGHT


@kernel(entry=True)
def taken(w: float, most: float) -> tuple[float, bool]:
    """Change of the slip velocity `w` by an impact, at most `most`; whether w becomes zero."""
    stops = abs(w) <= most
    return -w if stops else -math.copysign(most, w), stops


@kernel()
def scrape(tables: Tables, g: int, jump: float, left: Array, states: Array) -> None:
    """Apply friction at an impact that has changed the gap's rate by `jump`; modified in place."""
    for f in range(tables.scraped.shape[1]):
        most = tables.scraped[g, f, 0] * jump
        if most > 0.0:
            change, stops = taken(_slip(tables, g, f, states, 0), most)
            _change(tables, g, f, change, stops, left, states)


@kernel(entry=True)
def tail(
    ratio: float, w: float, pull: float, r: float, u: float, second: float, tolerance: float
) -> tuple[bool, bool, float, float]:
    """Whether friction slips throughout, or sticks throughout, the bounces from velocity `u` on.

    Then whether it sticks, the change of w when contact replaces the bounces, and the resulting
    error of positions. In flight w changes at the rate `pull`, and the gap's rate at `second`.

    Bounce i leaves at u r^i, lasts 2 u r^i/a and ends with an impulse of (1 + r) u r^i. Contact
    for the same time has the impulse of a, which is larger by u in total: therefore ratio u is
    added to a slip velocity beforehand. Friction that sticks moves in each flight and stops at its
    end.
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
    """Whether all friction at guard `g` slips, or sticks, throughout a `tail`; and the error.

    If so, the slip velocities are changed in place to those of contact, which then begins.
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
