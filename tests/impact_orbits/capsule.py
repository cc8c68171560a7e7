"""A vibro-impact capsule, and its motion by an integrator that knows nothing of dynkit."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dynkit.systems import DryFriction, HardStop, ImpactOscillator, MatrixOscillator

Vector = NDArray[np.float64]

INNER, SHELL, DRAG, GROUND = 1.0, 0.5, 0.1, 0.3


def capsule(
    frequency: float, force: float, gap: float, restitution: float, ground: float = GROUND
) -> MatrixOscillator:
    """A mass that a spring and a harmonic force move in a shell, which friction alone holds."""
    return MatrixOscillator(
        M=np.diag([INNER, SHELL]),
        C=DRAG * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        K=[[1.0, -1.0], [-1.0, 1.0]],
        frequency=frequency,
        harmonic_forces=[force, -force],
        elements=[
            HardStop((0, 1), offset=-gap, restitution=restitution, name="wall"),
            DryFriction(1, force=ground, name="ground"),
        ],
    )


@dataclass(frozen=True, kw_only=True)
class SoftCapsule(ImpactOscillator):
    """The same with a spring that hardens."""

    degrees_of_freedom = 2
    cubic: float

    def kinetic(self, v: Any) -> Any:
        return (INNER * v[0] ** 2 + SHELL * v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[1] - x[0]) ** 2 / 2 + self.cubic * (x[1] - x[0]) ** 4 / 4

    def dissipation(self, v: Any) -> Any:
        return DRAG * (v[1] - v[0]) ** 2 / 2


def hardened(system: Any, cubic: float) -> SoftCapsule:
    """A capsule with a spring that hardens."""
    return SoftCapsule(
        cubic=cubic,
        frequency=system.frequency,
        harmonic_forces=system.harmonic_forces,
        elements=system.elements,
    )


def integrated(system: MatrixOscillator, start: Vector, time: float) -> tuple[Vector, Vector]:
    """State (4,) a period after a state at a time, and the rates (k,) of the gap after impacts."""
    wall, ground = system.elements
    force, w, mu = system.harmonic_forces[0].real, system.frequency, ground.force
    end, y, rates = time + 2.0 * np.pi / w, np.array(start), []
    sign = int(np.sign(y[3])) * (abs(y[3]) > 1e-13)

    def inner(t: float, y: Vector) -> float:
        spring = y[1] - y[0] + DRAG * (y[3] - y[2])
        return (
            float(force * np.sin(w * t) + spring)
            if sign
            else float(force * np.sin(w * t) + y[1] - y[0] - DRAG * y[2])
        )

    def rate(t: float, y: Vector) -> list[float]:
        f = inner(t, y)
        return [y[2], y[3] * bool(sign), f / INNER, (-f - sign * mu) / SHELL * bool(sign)]

    def gap(t: float, y: Vector) -> float:
        return float(y[1] - y[0] - wall.offset)

    def holds(t: float, y: Vector) -> float:
        return float(sign * y[3]) if sign else mu - abs(inner(t, y))

    for event in (gap, holds):
        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
    while time < end:
        if not sign and abs(inner(time, y)) > mu:
            sign = -int(np.sign(inner(time, y)))
        found = solve_ivp(
            rate,
            (time, end),
            y,
            method="DOP853",
            rtol=3e-14,
            atol=1e-15,
            events=[gap, holds],
            max_step=0.05,
        )
        time, y = float(found.t[-1]), found.y[:, -1].copy()
        if found.status == 0:
            break
        if not gap(time, y) > 1e-12:
            impulse = (1.0 + wall.restitution) * (y[2] - y[3]) / (1.0 / INNER + 1.0 / SHELL)
            y[2:] += impulse * np.array([-1.0 / INNER, 1.0 / SHELL])
            rates.append(y[3] - y[2])
            sign = int(np.sign(y[3]))
        elif sign:
            y[3], sign = 0.0, 0
        else:
            sign = -int(np.sign(inner(time, y)))
    return y, np.array(rates)
