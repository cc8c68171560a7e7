"""What drives the gaps of an impact oscillator in steady motion, and how it changes."""

from __future__ import annotations

import cmath
from typing import TYPE_CHECKING, Any, NamedTuple, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.machine import Numbers

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure


@final
class Terms(NamedTuple):
    """The steady response without impacts, the gaps of all stops in it, and the law of impacts.

    The steady gap of stop e is Im(drives[e] exp(i phase)) + rests[e].

    Attributes
    ----------
    frequency : float
    restitutions : (e,)
    shape, still : (N,) complex, (N,)
        The steady response of all coordinates is Im(shape exp(i phase)) + still.
    drives, rests : (e,) complex, (e,)
    """

    frequency: float
    restitutions: Array
    shape: Any
    still: Array
    drives: Any
    rests: Array

    @classmethod
    def of(cls, oscillator: DrivenStructure) -> Self:
        """The terms of an oscillator whose elements are hard stops.

        Raises
        ------
        NoSolution
            When the forces have no steady response.
        """
        stops, still = oscillator._stops, oscillator._excitation.constant
        shape, drives = turning(oscillator)
        if still.any():
            still = _solved(oscillator.stiffness, still)
        rests = [s.sign * (s.row(len(still)) @ still - s.offset) for s in stops]
        r = np.array([stop.restitution for stop in stops], dtype=float)
        return cls(oscillator.frequency, r, shape, still, drives, np.array(rests))

    def gaps(self, sides: Any, turn: Any, orders: int) -> Array:
        """Steady gaps (orders, n) of the given stops and their derivatives, at exp(i phase), (n,).

        Derivatives are by time.
        """
        powers = (1j * self.frequency) ** np.arange(orders)
        out = np.asarray((powers[:, None] * (self.drives[sides] * turn)).imag)
        out[0] += self.rests[sides]
        return out

    def change(self, oscillator: DrivenStructure, by: Numbers) -> Terms:
        """The derivative of the terms by a parameter that changes no mass, dashpot or spring."""
        stops, n, w = oscillator._stops, oscillator._size, self.frequency
        harmonic, constant = by.forces[0] + 1j * by.forces[1], by.forces[2]
        if by.frequency:
            bent = 1j * oscillator.damping_matrix - 2.0 * w * oscillator.mass
            harmonic = harmonic - by.frequency * (bent @ self.shape)
        shape = _solved(_rigidity(oscillator), harmonic) if harmonic.any() else harmonic
        still = _solved(oscillator.stiffness, constant) if constant.any() else constant
        drives, rests, r = np.zeros(len(stops), complex), np.zeros(len(stops)), []
        for k, (stop, own) in enumerate(zip(stops, by.own, strict=True)):
            offset, amplitude, phase = own[:3].tolist()
            moved = (amplitude + 1j * stop.amplitude * phase) * cmath.exp(1j * stop.phase)
            drives[k], rests[k] = -stop.sign * moved, -stop.sign * offset
            if by.frequency or by.forces.any():
                row = stop.sign * stop.row(n)
                drives[k] += row @ shape
                rests[k] += row @ still
            r.append(own[4])
        return Terms(by.frequency, np.array(r), shape, still, drives, rests)


def turning(oscillator: DrivenStructure) -> tuple[Any, Any]:
    """The harmonic part of the steady response: `shape` (N,) and `drives` (e,) of `Terms`.

    Raises
    ------
    NoSolution
        When the forces have no steady response.
    """
    shape = oscillator._excitation.harmonic
    if shape.any():
        shape = _solved(_rigidity(oscillator), shape)
    drives = [s.sign * (s.row(len(shape)) @ shape - s.phasor) for s in oscillator._stops]
    return shape, np.array(drives)


def _solved(matrix: Any, forces: Any) -> Any:
    try:
        return np.linalg.solve(matrix, forces)
    except np.linalg.LinAlgError:
        raise NoSolution("the forces have no steady response") from None


def _rigidity(oscillator: DrivenStructure) -> Any:
    w = oscillator.frequency
    return oscillator.stiffness + 1j * w * oscillator.damping_matrix - w * w * oscillator.mass
