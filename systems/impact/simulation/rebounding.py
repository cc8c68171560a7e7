"""One automaton for all oscillators that differ only in the restitution of their table."""

from __future__ import annotations

from typing import Any, final

from dynkit.systems.impact.simulation.automaton import Automaton


@final
class Rebounding:
    """An automaton with the modes and guards of another one, but another restitution at all stops.

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
        # An automaton never replaces these attributes; simulations read them often.
        self.modes, self.guards, self.regimes = shared.modes, shared.guards, shared.regimes
        self.parts, self.beside = shared.parts, shared.beside

    def __getattr__(self, name: str) -> Any:
        return getattr(self.shared, name)

    @property
    def tables(self) -> Any:
        """The shared automaton's kernel tables with this restitution."""
        given = self.shared.tables
        if given is not self._given:
            own = given.restitution * self._restitution
            self._tables, self._given = given._replace(restitution=own), given
        return self._tables
