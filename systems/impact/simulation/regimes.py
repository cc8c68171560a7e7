"""Which regimes of elements go together, and which of them hold what others act along."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from dynkit.core.validation import Array
from dynkit.exponential.modes import LARGEST
from dynkit.systems.impact.elements.element import LAIN, Element, Regime
from dynkit.systems.impact.elements.friction import TURNED, DryFriction
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import rides
from dynkit.systems.impact.modes.structure import Structure


@final
class Parts:
    """The elements of a machine, by number, and their regimes.

    Raises
    ------
    ValueError
        Where springs or dashpots are too much for the masses that they act on.
    """

    def __init__(self, elements: Sequence[Element], structure: Structure) -> None:
        self._elements, self._structure = tuple(elements), structure
        self._regimes = [element.regimes for element in elements]
        self._along: dict[tuple[tuple[int, ...], int], bool | None] = {}
        self._sliders = [k for k, element in enumerate(elements) if element.slider]
        rubs = [k for k, element in enumerate(elements) if isinstance(element, DryFriction)]
        self._leads = {k: next((j for j in rubs if j < k and self.along((j,), k)), k) for k in rubs}
        for k, element in enumerate(elements):
            row = element.row(structure.size)
            for name in ("stiffness", "damping"):
                given = max(getattr(regime, name) for regime in self._regimes[k])
                over = row @ structure.contact(row).response
                if given > 0.0 and not given * over <= LARGEST:
                    raise ValueError(
                        f"elements[{k}].{name}, over the mass that it acts on, must not exceed "
                        f"{LARGEST:g}; got {given:g}"
                    )

    def now(self, regimes: Sequence[int]) -> list[Regime]:
        """What all elements do in these regimes."""
        return [own[k] for own, k in zip(self._regimes, regimes, strict=True)]

    def follows(self, element: int) -> bool:
        """Whether it is friction that slips and sticks as another one does, which leads."""
        return self._leads.get(element, element) != element

    def led(self, element: int) -> list[tuple[int, float]]:
        """Friction that slips and sticks as this one, itself first, and how fast beside it."""
        rows = [self._elements[k].row(self._structure.size) for k in range(len(self._elements))]
        own = rows[element]
        group = [k for k, leader in self._leads.items() if leader == element]
        return [(k, float(rows[k] @ own / (own @ own))) for k in group]

    def halted(self, given: Sequence[int], element: int, *, jumps: bool) -> list[int]:
        """Regimes where a slider turns: what slips along the same over the same surface sticks.

        Where its rate has jumped, other sliders do.
        """
        regimes, both = list(given), sum(self.grips(given), ())
        along = (*both, element) if self.along(both, element) is False else (element,)
        for k, own in enumerate(self._regimes):
            slips = k in self._sliders or (own[regimes[k]].halts and not jumps)
            if slips and self.along(along, k):
                regimes[k] = next(j for j, r in enumerate(own) if r.sticks or r.anchored)
        return regimes

    def settled(self, given: Sequence[int]) -> tuple[int, ...]:
        """Regimes that go together.

        Friction along one row over one surface slips and sticks together.

        Friction along what stops hold rests: how they share the force is open, and it takes none.
        Where they let go it sticks, and what then does not move lies at the stop. Sliders stick
        where what they follow does not move over their surfaces.
        """
        regimes = list(given)
        held = self.grips(regimes)[0]
        for k, own in enumerate(self._regimes):
            for stuck in (j for j, regime in enumerate(own) if regime.sticks):
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
        for k in self._sliders:
            if self.along(both, k):
                regimes[k] = 0
        return tuple(regimes)

    def holding(self, regimes: Sequence[int]) -> list[int]:
        """The elements that hold, or stick, and the stops that something lies at."""
        lain = [k for k, lies in enumerate(self.lain(regimes)) if lies]
        return sorted(sum(self.grips(regimes), ()) + tuple(lain))

    def lain(self, regimes: Sequence[int]) -> list[bool]:
        """Of all elements whether they are stops that are open, at which friction holds a mass."""
        pairs = zip(self._elements, regimes, strict=True)
        return [regime == LAIN and isinstance(element, HardStop) for element, regime in pairs]

    def grips(self, regimes: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The elements that hold, and those that stick where no others hold what they act along."""
        now = self.now(regimes)
        held = tuple(k for k, regime in enumerate(now) if regime.holds)
        sticking = (k for k, r in enumerate(now) if r.sticks and not self.follows(k))
        return held, tuple(k for k in sticking if self.along(held, k) is False)

    def along(self, others: tuple[int, ...], element: int) -> bool | None:
        """Whether others hold what an element acts along: see `rides`."""
        if (others, element) not in self._along:
            held = [self._elements[k] for k in others]
            found = rides(self._structure, held, self._elements[element])
            self._along[others, element] = found
        return self._along[others, element]

    def rubbed(self, regimes: Sequence[int], stop: int) -> list[bool]:
        """Of all elements whether they are friction that rests where this stop is closed, too."""
        held = self.grips(regimes)[0]
        return [
            any(regime.sticks for regime in own)
            and not self.follows(k)
            and self.along(held, k) is False
            and self.along((*held, stop), k) is True
            for k, own in enumerate(self._regimes)
        ]

    def turns(self, rubbed: Sequence[bool], change: Array) -> tuple[float, float]:
        """By how much friction changes a gap's acceleration where it turns, and the most it holds.

        Some of the elements rub; an impulse of one at the gap changes the velocities so, (N,).
        """
        drop = hold = 0.0
        for k in np.flatnonzero(rubbed).tolist():
            share = abs(float(self._elements[k].row(len(change)) @ change))
            drop += 2.0 * share * self.most(k)[0]
            hold += share * self.most(k)[1]
        return drop, hold

    def most(self, element: int) -> tuple[float, float]:
        """Of friction that sticks together the force, and the static one, along the first one."""
        force = static = 0.0
        for k, share in self.led(element):
            own = self._regimes[k]
            force += abs(share) * max(abs(regime.push) for regime in own)
            static += abs(share) * max(r.guards[0].level for r in own if r.sticks)
        return force, static
