"""Rules for the regimes of several elements: which elements hold, stick or rest together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import kept
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.exponential.modes import LARGEST
from dynkit.systems.impact.elements.element import (
    HALT,
    IMPACT,
    JUMP,
    LAIN,
    RIDES,
    SWITCH,
    Element,
    EventKind,
    Regime,
    Watch,
)
from dynkit.systems.impact.elements.friction import LANDED, OFF, STICKS, TURNED, DryFriction
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import (
    along_others,
    along_stops,
    depends,
    moves,
    pushed,
    rides,
)
from dynkit.systems.impact.modes.structure import ROUNDING, Structure, independent
from dynkit.systems.structure.symmetric import check_semidefinite


@final
class Parts:
    """The elements of a machine, by number, and the rules for their regimes.

    In messages an element has another number: its place among the elements that a user gave.

    Attributes
    ----------
    normal : dict
        Number of the hard stop whose contact force is the normal force of friction, by the number
        of the friction element.
    sliders : dict
        Number of the slider's coordinate, by the number of the element.
    falls : bool
        Whether an element has a negative dashpot: friction that decreases with the slip velocity.

    Raises
    ------
    ValueError
        When springs or dashpots are too large for the masses on which they act.
    """

    def __init__(
        self,
        elements: Sequence[Element],
        structure: Structure,
        normal: dict[int, int],
        numbers: Sequence[int] = (),
    ) -> None:
        self._elements, self._structure, self.normal = tuple(elements), structure, normal
        self._regimes = [element.regimes for element in elements]
        self._leads: dict[int, int] = {}
        self.falls = any(regime.damping < 0.0 for own in self._regimes for regime in own)
        places = iter(range(structure.size - structure.sliders, structure.size))
        self.sliders = {k: next(places) for k, e in enumerate(elements) if e.slider}
        rubs = [k for k, element in enumerate(elements) if isinstance(element, DryFriction)]
        for k in rubs:
            led = (j for j in rubs if j < k and len(self._alike((j,), k)) > 1)
            self._leads[k] = next((j for j in led if self.along((j,), k)), k)
        for k, element in enumerate(elements):
            if element.curved:  # the mass on which it acts varies
                continue
            row = element.row(structure.size)
            for name in ("stiffness", "damping"):
                given = max(getattr(regime, name) for regime in self._regimes[k])
                over = row @ structure.contact(row).response
                if given > 0.0 and not given * over <= LARGEST:
                    raise ValueError(
                        f"elements[{numbers[k]}].{name}, over the mass that it acts on, must not "
                        f"exceed {LARGEST:g}; got {given:g}"
                    )

    def now(self, regimes: Sequence[int]) -> list[Regime]:
        """The regimes of all elements, from the numbers of the regimes."""
        return [own[k] for own, k in zip(self._regimes, regimes, strict=True)]

    def check_slopes(self, own: Sequence[float]) -> None:
        """Refuse friction that decreases with slip by more than the dashpots compensate.

        `own` are the dashpots of all elements in their regimes.

        Raises
        ------
        Refused
            When the damping is not positive semidefinite. The limit in the message is the slope for
            which it just is.
        """
        rows = [element.row(self._structure.size) for element in self._elements]
        damping = self._structure.damping
        for k in sorted(range(len(own)), key=lambda k: own[k] < 0.0):  # dashpots first
            before, damping = damping, damping + own[k] * np.outer(rows[k], rows[k])
            if own[k] >= 0.0:
                continue
            try:
                check_semidefinite("damping", damping)
            except ValueError:
                along = np.linalg.lstsq(before, rows[k])[0]
                made_up = np.allclose(before @ along, rows[k], rtol=0.0, atol=ROUNDING)
                limit = -1.0 / float(rows[k] @ along) if made_up else 0.0
                raise Refused(
                    f"slope must not be less than {limit}, for which dashpots just make up; "
                    f"got {own[k]} of {self._elements[k]!r}"
                ) from None

    def follows(self, element: int) -> bool:
        """Whether the element is friction that slips and sticks together with an earlier one."""
        return self._leads.get(element, element) != element

    def led(self, element: int) -> list[tuple[int, float]]:
        """Friction elements that slip and stick as this one, and ratios of their slip velocities.

        The first is the element itself.
        """
        group = [k for k, leader in self._leads.items() if leader == element]
        alike = self._alike(tuple(group), element)
        own, *rows = (each.row(self._structure.size) for each in alike)
        pairs = zip(group, rows, strict=True)
        return [(k, float(row @ own / (own @ own))) for k, row in pairs]

    def halted(self, given: Sequence[int], element: int, *, jumps: bool) -> list[int]:
        """Regimes after a halt: friction on the same row and surface sticks as well.

        After a jump of the rate, or if elements that hold move the row, only sliders do so.
        """
        regimes, both = list(given), sum(self.grips(given), ())
        rides = self.along(both, element)
        along = (*both, element) if rides is False else (element,)
        turns = jumps or rides is None
        for k, own in enumerate(self._regimes):
            slips = k in self.sliders or (own[regimes[k]].halts and not turns)
            if slips and self.along(along, k):
                regimes[k] = next(j for j, r in enumerate(own) if r.sticks or r.anchored)
        return regimes

    def after(self, given: Sequence[int], guard: Any) -> tuple[int, ...]:
        """The regimes that a guard leads to."""
        regimes, k = list(given), guard.element
        released = self.now(regimes)[k].holds and self.hard(k)
        regimes[k] = LAIN if released else guard.watch.to
        if k in self.sliders and guard.watch.rate:
            regimes = self.halted(regimes, k, jumps=guard.watch.event == JUMP)
        return self.settled(regimes)

    def settled(self, given: Sequence[int]) -> tuple[int, ...]:
        """Make regimes consistent.

        Friction at a contact is off while the contact is open, and undecided when it begins.
        Friction elements on one row and one surface slip and stick together. Friction on a row that
        stops hold is at rest; the shares of the force are not determined, and friction takes none.
        When the stop opens, this friction sticks, and a mass that then does not move stays at the
        stop (`LAIN`). Sliders stick while the coordinate that they follow does not move over their
        surfaces.
        """
        return self._settled(tuple(given))

    @kept
    def _settled(self, given: tuple[int, ...]) -> tuple[int, ...]:
        regimes = list(given)
        held = self.grips(regimes)[0]
        for k, stop in self.normal.items():
            along = self.along(held, k)
            if stop not in held:
                regimes[k] = OFF
            elif along or regimes[k] == OFF or (along is None and regimes[k] == STICKS):
                regimes[k] = STICKS if along else LANDED
        for k in (k for k in range(len(regimes)) if k not in self.normal):
            for stuck in (j for j, regime in enumerate(self._regimes[k]) if regime.sticks):
                along = self.along(held, k)
                if along or (along is None and regimes[k] == stuck):
                    regimes[k] = stuck if along else 0
        both = sum(self.grips(regimes), ())
        for k, lies in enumerate(self.lain(regimes)):
            if lies and not self.along(both, k):
                regimes[k] = 0
        for k in (k for k in self._leads if self.follows(k)):
            leader = self._leads[k]
            back = dict(self.led(leader))[k] * self._elements[k].sign * self._elements[leader].sign
            regimes[k] = TURNED[regimes[leader]] if back < 0.0 else regimes[leader]
        for k in self.sliders:
            if self.along(both, k):
                regimes[k] = 0
        return tuple(regimes)

    def holding(self, regimes: Sequence[int]) -> list[int]:
        """Numbers of the elements that hold or stick, and of the stops at which a mass stays."""
        lain = [k for k, lies in enumerate(self.lain(regimes)) if lies]
        return sorted(sum(self.grips(regimes), ()) + tuple(lain))

    def lain(self, regimes: Sequence[int]) -> list[bool]:
        """For each element, whether it is an open stop at which friction holds a mass."""
        pairs = zip(self._elements, regimes, strict=True)
        return [regime == LAIN and isinstance(element, HardStop) for element, regime in pairs]

    def slides(self, regimes: Sequence[int]) -> list[int]:
        """For each element, how its slider slides or sticks: see `Tables.slides`."""
        both, out = sum(self.grips(regimes), ()), [0] * len(regimes)
        for k in self.sliders:
            regime = self._regimes[k][regimes[k]]
            rides = RIDES if regime.anchored and self.along(both, k) else 0
            out[k] = rides or int(np.sign(regime.stretch))
        return out

    def grips(self, regimes: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Numbers of the elements that hold, and of those that stick on rows that no stop holds."""
        return self._grips(tuple(regimes))

    @kept
    def _grips(self, regimes: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        now = self.now(regimes)
        held = tuple(k for k, regime in enumerate(now) if regime.holds)
        sticking = (k for k, r in enumerate(now) if r.sticks and not self.follows(k))
        return held, tuple(k for k in sticking if self.along(held, k) is False)

    @kept
    def along(self, others: tuple[int, ...], element: int) -> bool | None:
        """Whether other elements hold the row of an element: see `rides`."""
        own, *given = self._alike(others, element)
        rows = np.array([each.row(self._structure.size) for each in given])
        held = [given[k] for k in independent(rows)]
        rests = rides(self._structure, held, own)
        if rests is False and others and self._structure.size == 1 + self._structure.sliders:
            still = not any(self._elements[k].moves for k in (*others, element))
            rests = True if still else None  # all functions of one coordinate are held together
        return rests

    def _alike(self, others: tuple[int, ...], element: int) -> list[Element]:
        """An element, and those of other elements whose rows can be compared with its own.

        Elements along rows are compared with each other. Elements along a function of the
        coordinates are compared with those along the same function, as if along one coordinate.
        """
        own = self._elements[element]
        given = [own, *(self._elements[k] for k in others)]
        if own.curved:
            return [replace(e, coordinate=0) for e in given if e.coordinate == own.coordinate]
        return [e for e in given if not e.curved]

    def riding(self, regimes: Sequence[int]) -> list[bool | None]:
        """For each element whether others hold its row: see `along`.

        Others are the elements that hold; for friction and sliders also those that stick. A stop is
        also held if elements that stick keep its mass at rest: it cannot be reached.

        Raises
        ------
        CannotFollow
            When friction slips or sticks along a row that other friction holds.
        """
        held, sticking = self.grips(regimes)
        both, out = held + sticking, list[bool | None]()
        for k, regime in enumerate(self.now(regimes)):
            rubs = regime.halts or k in self.sliders
            rides = self.along(both if rubs else held, k)
            others = tuple(j for j in both if j != k)
            bound = k in sticking and self.along(others, k) is not False
            if bound or (regime.halts and rides):
                raise along_others(self._elements[k])
            out.append(self.along(both, k) or False if self.hard(k) and rides is False else rides)
        return out

    def watches(
        self, regimes: Sequence[int], riding: Sequence[bool | None]
    ) -> list[tuple[int, Watch]]:
        """Guards of a mode, as pairs of an element and a guard.

        An element whose row others hold has no guard. Friction on a row that others move does not
        halt. A slider reverses when friction on its row and surface halts; then it has no guard of
        its own for this event.
        """
        both, found = sum(self.grips(regimes), ()), list[tuple[int, Watch]]()
        now = self.now(regimes)
        halting = [k for k in self._leads if now[k].halts and riding[k] is False]
        for k, regime in enumerate(now):
            own: Sequence[Watch] = regime.guards
            if k in both:
                own = [self._shared(k, watch) for watch in own]
            elif riding[k] or self.follows(k):
                own = ()
            elif riding[k] is None and own and own[0].event == HALT:
                own = [replace(w, event=SWITCH, order=1) for w in own if w.event == JUMP]
            elif k in self.sliders and any(self.along((j,), k) for j in halting):
                own = [w for w in own if w.event == JUMP or not w.rate]
            found += [(k, watch) for watch in own]
        return found

    def _shared(self, element: int, watch: Watch) -> Watch:
        """The guard of a friction force, or of the total force of friction that sticks together."""
        if len(self.led(element)) < 2:
            return watch
        force, static = self.most(element)
        return replace(watch, level=static, order=2 if force == static else 1)

    def hard(self, element: int) -> bool:
        """Whether an element is a hard stop."""
        return isinstance(self._elements[element], HardStop)

    def table(self, modes: Sequence[Sequence[int]], guards: Sequence[Any]) -> NDArray[np.intp]:
        """Mode, element, next mode and kind of the event of each guard, (guards, 4).

        `modes` are the regimes of all elements in each mode.
        """

        def kind(guard: Any) -> EventKind:
            if guard.watch.event == IMPACT:
                return EventKind.CONTACT
            now = self._regimes[guard.element][modes[guard.mode][guard.element]]
            released = now.holds and self.hard(guard.element)
            return EventKind.RELEASE if released else EventKind.SWITCH

        rows = [(guard.mode, guard.element, guard.target, kind(guard)) for guard in guards]
        return np.array(rows, dtype=np.intp).reshape(-1, 4)

    def pushed(
        self, regimes: Sequence[int], hit: int, there: tuple[Array, Array] | None = None
    ) -> tuple[int, bool]:
        """Sticking element that an impact moves, or closed stop that it opens; -1 for none.

        Then whether the impact pushes against a closed stop. A stop along a row that closed stops
        hold can be hit only if the impact opens one of these. Where masses or rows vary, `there`
        are the mass matrix (N, N) and the rows (elements, N) of the state.
        """
        held, sticking = self.grips(regimes)
        closed = [k for k in held if self.hard(k)]
        size = self._structure.size
        mass, rows = there or (
            self._structure.mass,
            np.array([e.row(size) for e in self._elements]),
        )
        signed = np.array([element.sign for element in self._elements])[:, None] * rows

        def rests(others: Sequence[int]) -> bool:
            if there is None:
                return self.along(tuple(others), hit) is not False
            return bool(others) and depends(mass, rows[[*others, hit]])

        if rests(closed):
            opened = pushed(mass, signed[[*closed, hit]])[0]
            others = [k for k in closed if opened < 0 or k != closed[opened]]
            away = opened >= 0 and not rests(others)
            return closed[opened] if away else -1, False
        for k in (*sticking, *(k for k in held if k not in closed)):  # these transmit no impulse
            if moves(mass, rows[[*closed, hit]], rows[k]):
                return k, False
        if not closed:
            return -1, False
        opened, ambiguous = pushed(mass, signed[[*closed, hit]])
        return closed[opened] if opened >= 0 else -1, ambiguous

    @property
    def most_rubs(self) -> int:
        """The largest number of friction elements with the same stop as their normal."""
        stops = list(self.normal.values())
        return max(map(stops.count, stops), default=0)

    def tractions(self, regimes: Sequence[int]) -> list[tuple[int, int, float]]:
        """Friction that slips at contacts: its number, that of its stop, and its traction.

        The traction is the friction force over the contact force, both along the elements' rows.
        """
        found, now = [], self.now(regimes)
        for k, stop in self.normal.items():
            if now[k].traction:
                sign = self._elements[k].sign * self._elements[stop].sign
                found.append((k, stop, sign * now[k].traction))
        return found

    def rubbed(self, regimes: Sequence[int], stop: int) -> list[bool]:
        """For each element, whether it is friction that is at rest while this stop is closed."""
        held = self.grips(regimes)[0]
        for k in self.normal:
            if self.along(held, k) is False and self.along((*held, stop), k) is not False:
                raise along_stops(self._elements[k])
        return [
            any(regime.sticks for regime in own)
            and not self.follows(k)
            and self.along(held, k) is False
            and self.along((*held, stop), k) is True
            for k, own in enumerate(self._regimes)
        ]

    def turns(self, rubbed: Sequence[bool], changes: Array) -> tuple[float, float]:
        """Decrease of a gap's acceleration when friction reverses; most that the friction holds.

        Both are accelerations. `rubbed` marks the friction elements along the row of the gap;
        `changes` (elements,) are the rates along all elements by a unit impulse at the gap.
        """
        drop = hold = 0.0
        for k in np.flatnonzero(rubbed).tolist():
            share = abs(float(changes[k]))
            drop += 2.0 * share * self.most(k)[0]
            hold += share * self.most(k)[1]
        return drop, hold

    def most(self, element: int) -> tuple[float, float]:
        """Total kinetic and static force of friction that sticks together, along the first row."""
        force = static = 0.0
        for k, share in self.led(element):
            own = self._regimes[k]
            force += abs(share) * max(abs(regime.push) for regime in own)
            static += abs(share) * max(r.guards[0].level for r in own if r.sticks)
        return force, static
