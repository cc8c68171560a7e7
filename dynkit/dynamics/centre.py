"""Small periodic orbits around equilibria of conservative flows."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from dynkit.core.validation import Array, one_of
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane, PoincareSection
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.periodic_orbit import periodic_orbit

# Largest real part of the eigenvalues of a centre, relative to the largest eigenvalue; largest
# distance of a ratio of frequencies from an integer, relative.
_CENTRE = 1e-9
# A coordinate whose amplitude is at least this fraction of the largest one may define the plane.
_SHARE = 1.0 / 3.0
# Amplitudes of successive orbits, relative to the size of the state. The guess of the first orbit
# has an error of second order, which instability may multiply by thousands; the guesses of the
# others are extrapolated.
_AMPLITUDES = 10.0 ** np.array([-4.0, -3.5, -3.0, -2.5, -2.0])
# Time limit of a return, in periods of the linear oscillation; largest number of Newton steps at
# one amplitude.
_PERIODS, _STEPS = 10.0, 8


def small_orbits(
    flow: Flow, state: Array, integral: str, section: PoincareSection | None
) -> list[MapOrbit]:
    """Return an orbit of each family at an equilibrium; see `Equilibrium.lyapunov_orbits`."""
    one_of("integral", integral, flow.integrals)
    values, modes = np.linalg.eig(flow.velocity_jacobian(state))
    centre = (values.imag > 0.0) & (abs(values.real) <= _CENTRE * abs(values).max())
    frequencies = values.imag[centre]
    for fast, slow in permutations(frequencies, 2):
        ratio = fast / slow
        if round(ratio) and abs(ratio - round(ratio)) <= _CENTRE * ratio:
            raise ValueError(
                "frequencies of the equilibrium must not be multiples of one another; got "
                f"{fast:.6g} and {slow:.6g}"
            )
    order = np.argsort(-frequencies)
    pairs = zip(frequencies[order], modes.T[centre][order], strict=True)
    return [_small_orbit(flow, state, integral, section, *pair) for pair in pairs]


def _small_orbit(
    flow: Flow,
    state: Array,
    integral: str,
    section: PoincareSection | None,
    frequency: float,
    mode: Any,
) -> MapOrbit:
    if section is None:
        shares = abs(mode)
        normal = np.eye(len(mode))[int(np.argmax(shares >= _SHARE * shares.max()))]
        section = Hyperplane(normal, float(normal @ state))
    returns = PoincareMap(flow, section, _PERIODS * 2.0 * np.pi / frequency)
    size, way = float(abs(state).max()) or 1.0, section.direction * section.gradient(state)
    along = size * (section.reduce_derivative(state) @ crossing(mode / abs(mode).max(), way))
    place, bend = section.reduce(state), np.zeros(len(along))
    for amplitude in _AMPLITUDES:
        guess = place + amplitude * along + amplitude**2 * bend
        found = _with_amplitude(returns, guess, along)
        bend = (found - place - amplitude * along) / amplitude**2
    level = integral, flow.integral(integral, section.lift(found))
    return periodic_orbit(PoincareMap(flow, section, returns.time_limit, level=level), found)


def _with_amplitude(returns: PoincareMap, guess: Array, along: Array) -> Array:
    """Return the orbit of the family that has the amplitude of a guess, by Newton's method.

    The orbits of the family have different values of the integral, so that one equation depends on
    the others.
    """
    x, row, least = guess, along / float(np.linalg.norm(along)), np.inf
    for _ in range(_STEPS):
        gap = returns(x) - x
        size = float(abs(gap).max())
        if not size < 0.5 * least:
            break
        least = size
        matrix = np.vstack([returns.jacobian(x) - np.eye(len(x)), row])
        x = x - np.linalg.lstsq(matrix, np.append(gap, 0.0), rcond=None)[0]
    return x


def crossing(mode: Any, normal: Array) -> Array:
    """Return Re(mode exp(i omega t)), (d,), at the time when it crosses a plane."""
    across = complex(normal @ mode)
    # at this time the distance from the plane is zero, and its rate along the normal is largest
    return np.asarray((mode * (-1j * across.conjugate() / abs(across))).real)
