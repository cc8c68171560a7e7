"""The numbers that an orbit of an impact oscillator depends on, beside its structure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.simulation.parameters import EXACT

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.impulse_responses import FreeMotion
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

_NO_CHANGES: Mapping[str, float] = {}


@final
class Terms(NamedTuple):
    """What acts on the contact coordinate, and the law of impacts.

    The steady part of the contact coordinate less the table is Im(drive exp(i phase)) + rest.

    Attributes
    ----------
    frequency, restitution : float
    shape, still : (N,) complex, (N,)
        The steady response of all coordinates is Im(shape exp(i phase)) + still.
    drive, drive_rate : complex, and its derivative by the frequency
    turning : (3, 1) complex
        Takes Im(exp(i phase)) to it and its first two derivatives in time.
    rest : float, without the offset of the table
    places : (sides,) offsets of table and far stop
    signs : (sides,) on which side of them the structure is
    """

    frequency: float
    restitution: float
    shape: Any
    still: Array
    drive: complex
    drive_rate: complex
    turning: Any
    rest: float
    places: Array
    signs: Array

    @staticmethod
    def of(
        oscillator: DrivenStructure, motion: FreeMotion, changes: Mapping[str, float] = _NO_CHANGES
    ) -> Terms:
        """The terms of an oscillator, with other values of some of the `EXACT` parameters.

        Parameters
        ----------
        motion : FreeMotion
            From `forced_motion`.

        Raises
        ------
        NoSolution
            When a value is out of range, or the forces have no steady response.
        """
        values = {name: changes.get(name, getattr(oscillator, name)) for name in EXACT}
        w, r, a = values["frequency"], values["restitution"], values["amplitude"]
        if not (w > 0.0 and 0.0 <= r <= 1.0 and a >= 0.0 and values["play"] > 0.0):
            raise NoSolution(f"parameters are out of range: {values}")
        shape, by_frequency, still = _steady_response(oscillator, motion, w)
        c, sign = oscillator.contact, 1.0 if oscillator.side == "above" else -1.0
        places, signs = [values["offset"]], [sign]
        if math.isfinite(values["play"]):
            places.append(values["offset"] + sign * values["play"])
            signs.append(-sign)
        drive = complex(shape[c]) - a
        rate, rest = complex(by_frequency[c]), float(still[c])
        turning, borders = np.array([[1.0], [1j * w], [-w * w]]), np.array([places, signs])
        return Terms(w, r, shape, still, drive, rate, turning, rest, *borders)

    def gaps(self, sides: Any, turn: Any) -> Array:
        """Steady part (3, n) of the gaps of the given sides, and of its derivatives in time.

        At exp(i phase), (n,).
        """
        steady = (self.turning * (self.drive * turn)).imag
        steady[0] += self.rest - self.places[sides]
        return np.asarray(self.signs[sides] * steady)

    def gaps_by_frequency(self, sides: Any, turn: Any) -> Array:
        """Derivative (2, n) by the frequency of the gaps, and of their rates in time."""
        by = [[self.drive_rate], [1j * (self.drive + self.frequency * self.drive_rate)]]
        return np.asarray(self.signs[sides] * (np.array(by) * turn).imag)


def _steady_response(
    oscillator: DrivenStructure, motion: FreeMotion, w: float
) -> tuple[Any, Any, Array]:
    """Steady response (N,), its derivative by the frequency (N,), and the place of rest (N,).

    Where some of the motion has no restoring force, the place is that of the rest of it.
    """
    harmonic, constant = oscillator._excitation.harmonic, oscillator._excitation.constant
    shape, by_frequency, still = harmonic, harmonic, constant
    try:
        if harmonic.any():
            mass, damping = oscillator.mass, oscillator.damping_matrix
            rigidity = oscillator.stiffness + 1j * w * damping - w * w * mass
            shape = np.linalg.solve(rigidity, harmonic)
            by_frequency = np.linalg.solve(rigidity, (2.0 * w * mass - 1j * damping) @ shape)
        if len(motion.neutral):
            still = motion.mode.forced.rest
        elif constant.any():
            still = np.asarray(np.linalg.solve(oscillator.stiffness, constant), dtype=float)
    except np.linalg.LinAlgError:
        raise NoSolution("the forces have no steady response") from None
    return shape, by_frequency, still
