"""Friction at impacts: changes of slip velocities by impulses, from masses and rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Watch
from dynkit.systems.impact.elements.friction import DryFriction
from dynkit.systems.impact.modes.constrained import carries, sum_of
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.modes.structure import Structure
from dynkit.systems.impact.simulation.regimes import Parts


class Rub(NamedTuple):
    """Friction at an impact, and its `ratio` as in `Scrape`."""

    element: int
    ratio: float


class Scrape(NamedTuple):
    """Friction at an impact.

    Attributes
    ----------
    element : int
    ratio : float
        Largest change of the slip velocity, divided by the change of the gap's rate.
    slip : the slip velocity, as an exponential sum
    kick : (4, slots) change of the state by a unit jump of the slip velocity, then its low parts
    excursion : (2, m) change of the mode's coordinates by a brief excursion of the slip, while the
        gap has a brief excursion with a time integral of one
    coupling : float
        Largest change of a position or velocity by this excursion.
    """

    element: int
    ratio: float
    slip: Any
    kick: Array
    excursion: Array
    coupling: float


def scrapes_of(
    structure: Structure,
    mode: Mode,
    elements: Sequence[Element],
    parts: Parts,
    regimes: tuple[int, ...],
    stop: int,
) -> tuple[tuple[Scrape, ...], bool]:
    """Friction at an impact at a stop, and whether mass coupling leaves its effect open."""
    size, found = structure.size, []
    rows = np.array([element.row(size) for element in elements])
    rubs, open_ = rubbing(structure.mass, rows, elements, parts, regimes, stop)
    basis = mode.forced.basis
    for k in rubs if basis is not None else ():
        assert basis is not None
        friction, contact, normal = elements[k], mode.contact(rows[k]), mode.contact(rows[stop])
        over = contact.row @ contact.response / (normal.row @ normal.response)
        ratio = _kinetic(friction) * float(over)
        slip = sum_of(mode, friction, Watch(to=0, rate=1.0), -1)
        kick = friction.sign * mode.placed(contact.kick)
        moved = ratio * contact.dragged
        excursion = basis.coordinates(*moved)
        found.append(Scrape(k, ratio, slip, kick, excursion, float(abs(moved).max())))
    return tuple(found), open_


def rubbing(
    mass: Array,
    rows: Array,
    elements: Sequence[Element],
    parts: Parts,
    regimes: tuple[int, ...],
    stop: int,
) -> tuple[list[int], bool]:
    """Numbers of the friction elements that an impact at a stop affects, and whether this is open.

    The effect is open if the masses couple friction to the stop or to elements that hold or stick.
    The mass matrix is (N, N), the rows of all elements are (elements, N).
    """
    both, found, open_ = sum(parts.grips(regimes), ()), list[int](), False
    rubs = [k for k, normal in parts.normal.items() if normal == stop]
    for k in rubs:
        change, along = np.linalg.solve(mass, rows[k]), parts.along(both, k)
        others = rows[[*both, stop, *(j for j in rubs if j != k)]]
        coupled = any(carries(mass, row, change) for row in others)
        if coupled and along is not True and _kinetic(elements[k]) > 0.0:
            open_ = True
        elif along is False:
            found.append(k)
    return found, open_


def _kinetic(friction: Element) -> float:
    assert isinstance(friction, DryFriction)
    return friction.kinetic


def packed(scrapes: Sequence[Scrape], most: int, slots: int) -> tuple[Array, Array]:
    """Arrays ``scraped`` (most, 3) and ``scrape`` (most, 8, slots) of one guard in `Tables`."""
    numbers, rows = np.zeros((most, 3)), np.zeros((most, 8, slots))
    for own, out, part in zip(numbers, rows, scrapes, strict=False):
        own[:] = part.ratio, part.slip.offset, part.element
        out[:4, : part.slip.rows.shape[1]], out[4:] = part.slip.rows[:4], part.kick
    return numbers, rows


def stopping(change: Array, mode: Mode, friction: Element) -> Array:
    """A change of basis (2 slots, 2 slots + 1) from a mode, after an impulse that stops a slip."""
    row = friction.row(len(mode.forced.rest))
    slip = sum_of(mode, friction, Watch(to=0, rate=1.0), -1)
    kick = mode.placed(friction.sign * mode.contact(row).kick[:2])
    by = np.zeros_like(kick)
    by[:, : slip.rows.shape[1]] = slip.rows[:2]
    return change - np.outer(change[:, :-1] @ kick.ravel(), np.append(by, slip.offset))
