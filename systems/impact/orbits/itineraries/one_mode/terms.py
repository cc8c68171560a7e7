"""Steady response and gaps of an impact oscillator without impacts, and their derivatives."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.machine import Numbers
from dynkit.systems.impact.simulation.parameters import EXACT

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure


_NO_CHANGES: Mapping[str, float] = {}


@final
class Terms(NamedTuple):
    """The steady response without impacts, the gaps of all stops in it, and the restitutions.

    The steady gap of stop e is Im(drives[e] exp(i phase)) + rests[e].

    Attributes
    ----------
    frequency : float
    restitutions : (e,)
    shape, still : (N,) complex, (N,)
        The steady response of all coordinates is Im(shape exp(i phase)) + still.
    drives, rests : (e,) complex, (e,)
    numbers : (e, 4)
        Real and imaginary parts of drives, rests, and restitutions: an argument of the kernel.
    """

    frequency: float
    restitutions: Array
    shape: Any
    still: Array
    drives: Any
    rests: Array
    numbers: Array

    def at(self, oscillator: DrivenStructure, changes: Mapping[str, float]) -> Self:
        """Return the terms at other values of some parameters of the table, all `EXACT`.

        Raises
        ------
        NoSolution
            When a value is out of range, or the forces have no steady response.
        """
        frequency = changes.get("frequency", 0.0)
        if len(changes) == 1 and frequency > 0.0 and not self.shape.any():
            return self._replace(frequency=frequency)
        return self.of(oscillator, changes)

    @classmethod
    def of(cls, oscillator: DrivenStructure, changes: Mapping[str, float] = _NO_CHANGES) -> Self:
        """Return the terms of an oscillator whose elements are hard stops.

        `changes` are other values of some parameters of its table, which must be `EXACT` ones.

        Raises
        ------
        NoSolution
            When a value is out of range, or the forces have no steady response.
        """
        stops, still = oscillator._stops, oscillator._excitation.constant
        w, phasors = oscillator.frequency, [stop.phasor for stop in stops]
        offsets, r = [stop.offset for stop in stops], [stop.restitution for stop in stops]
        if changes:
            values = {name: changes.get(name, getattr(oscillator, name)) for name in EXACT}
            w, restitution, amplitude, offset, play = values.values()
            if not (w > 0.0 and 0.0 <= restitution <= 1.0 and amplitude >= 0.0 and play > 0.0):
                raise NoSolution(f"parameters are out of range: {values}")
            phasors, r = [complex(amplitude)] * len(stops), [restitution] * len(stops)
            offsets = [offset, offset + stops[0].sign * play][: len(stops)]
        shape, drives = turning(oscillator, w, phasors)
        if still.any():
            still = _solved(oscillator.stiffness, still)
        own = zip(stops, offsets, strict=True)
        rests = np.array([s.sign * (s.row(len(still)) @ still - at) for s, at in own])
        numbers = np.array([drives.real, drives.imag, rests, r]).T.copy()
        return cls(w, numbers[:, 3], shape, still, drives, rests, numbers)

    def gaps(self, sides: Any, turn: Any, orders: int) -> Array:
        """Steady gaps of stops and their time derivatives, (orders, n), at exp(i phase), (n,)."""
        powers = (1j * self.frequency) ** np.arange(orders)
        out = np.asarray((powers[:, None] * (self.drives[sides] * turn)).imag)
        out[0] += self.rests[sides]
        return out

    def change(self, oscillator: DrivenStructure, by: Numbers) -> Terms:
        """Derivative of the terms by a parameter that changes no mass, dashpot or spring."""
        stops, n, w = oscillator._stops, oscillator._size, self.frequency
        harmonic, constant = by.forces[0] + 1j * by.forces[1], by.forces[2]
        if by.frequency and self.shape.any():
            bent = 1j * oscillator.damping_matrix - 2.0 * w * oscillator.mass
            harmonic = harmonic - by.frequency * (bent @ self.shape)
        shape = _solved(_rigidity(oscillator, w), harmonic) if harmonic.any() else harmonic
        still = _solved(oscillator.stiffness, constant) if constant.any() else constant
        drives, rests, r = np.zeros(len(stops), complex), np.zeros(len(stops)), []
        for k, (stop, own) in enumerate(zip(stops, by.own, strict=True)):
            offset, amplitude, phase = own[:3].tolist()
            moved = (amplitude - 1j * stop.amplitude * phase) * cmath.exp(-1j * stop.phase)
            drives[k], rests[k] = -stop.sign * moved, -stop.sign * offset
            if harmonic.any() or constant.any():
                row = stop.sign * stop.row(n)
                drives[k] += row @ shape
                rests[k] += row @ still
            r.append(own[4])
        return Terms(by.frequency, np.array(r), shape, still, drives, rests, np.empty((0, 4)))


def turning(oscillator: DrivenStructure, w: float, phasors: Sequence[complex]) -> tuple[Any, Any]:
    """The harmonic part of the steady response: `shape` (N,) and `drives` (e,) of `Terms`.

    Raises
    ------
    NoSolution
        When the forces have no steady response.
    """
    shape = oscillator._excitation.harmonic
    drives = np.array([-s.sign * own for s, own in zip(oscillator._stops, phasors, strict=True)])
    if shape.any():
        shape = _solved(_rigidity(oscillator, w), shape)
        drives = drives + [s.sign * (s.row(len(shape)) @ shape) for s in oscillator._stops]
    return shape, drives


def drives_of(oscillator: DrivenStructure) -> Any:
    """Complex amplitudes (e,) of the steady gaps; NoSolution without a steady response."""
    phasors = [stop.phasor for stop in oscillator._stops]
    return turning(oscillator, oscillator.frequency, phasors)[1]


def _solved(matrix: Any, forces: Any) -> Any:
    try:
        return np.linalg.solve(matrix, forces)
    except np.linalg.LinAlgError:
        raise NoSolution("the forces have no steady response") from None


def _rigidity(oscillator: DrivenStructure, w: float) -> Any:
    return oscillator.stiffness + 1j * w * oscillator.damping_matrix - w * w * oscillator.mass
