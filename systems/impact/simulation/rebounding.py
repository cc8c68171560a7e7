"""One automaton for oscillators that differ in the restitution of their table alone."""

from __future__ import annotations

from typing import Any, final

from dynkit.systems.impact.simulation.automaton import Automaton


@final
class Rebounding:
    """An automaton whose stops have another coefficient of restitution.

    Its modes and guards are those of the other automaton.

    Parameters
    ----------
    shared : Automaton
        Automaton with a restitution of one at all stops.
    restitution : float
    """

    def __init__(self, shared: Automaton, restitution: float) -> None:
        self.shared = shared
        self._restitution = restitution
        self._given: Any = None
        self._tables: Any = None
        # what an automaton never replaces, and simulations read often
        self.modes, self.guards, self.regimes = shared.modes, shared.guards, shared.regimes
        self.parts, self.beside = shared.parts, shared.beside

    def __getattr__(self, name: str) -> Any:
        return getattr(self.shared, name)

    @property
    def tables(self) -> Any:
        """The tables of the kernels."""
        given = self.shared.tables
        if given is not self._given:
            own = given.restitution * self._restitution
            self._tables, self._given = given._replace(restitution=own), given
        return self._tables
