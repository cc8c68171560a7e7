"""Friction at an impact, by the masses that it acts on: what an impulse does to the slip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Watch
from dynkit.systems.impact.elements.friction import DryFriction
from dynkit.systems.impact.modes.constrained import sum_of
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.modes.structure import ROUNDING, Structure
from dynkit.systems.impact.simulation.regimes import Parts


class Scrape(NamedTuple):
    """Friction at an impact.

    Attributes
    ----------
    element : int
    ratio : float
        Largest change of the slip velocity over the change of the rate of the gap.
    slip : the slip velocity, as an exponential sum
    kick : (4, slots) change of the state by a unit jump of it, then the low parts
    excursion : (2, m) change of the mode's coordinates by brief excursions, over those of the gap
    coupling : float
        Largest change of a position or velocity by the same.
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
    """Friction at an impact at a stop, and whether the masses leave its outcome open."""
    size, both = structure.size, sum(parts.grips(regimes), ())
    rubs = [k for k, normal in parts.normal.items() if normal == stop]
    fixed = [elements[k].row(size) for k in (*both, stop)]
    found, open_ = [], False
    for k in rubs:
        friction = elements[k]
        assert isinstance(friction, DryFriction)
        row, along = friction.row(size), parts.along(both, k)
        change = structure.contact(row).response
        others = fixed + [elements[j].row(size) for j in rubs if j != k]
        coupled = any(abs(o @ change) > ROUNDING * (abs(o) @ abs(change)) for o in others)
        if coupled and along is not True and friction.kinetic > 0.0:
            open_ = True
        elif along is False and mode.forced.basis is not None:
            contact, normal = mode.contact(row), mode.contact(elements[stop].row(size))
            over = contact.row @ contact.response / (normal.row @ normal.response)
            ratio = friction.kinetic * float(over)
            slip = sum_of(mode, friction, Watch(to=0, rate=1.0), -1)
            kick = friction.sign * mode.placed(contact.kick)
            moved = ratio * contact.dragged
            excursion = mode.forced.basis.coordinates(*moved)
            found.append(Scrape(k, ratio, slip, kick, excursion, float(abs(moved).max())))
    return tuple(found), open_


def packed(scrapes: Sequence[Scrape], most: int, slots: int) -> tuple[Array, Array]:
    """Numbers (most, 3) and rows (most, 8, slots) of friction for the kernels: see `Tables`."""
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
