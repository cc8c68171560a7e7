"""Flows given by expressions whose state jumps when a guard falls to zero."""

from __future__ import annotations

from typing import Any

from dynkit.core.validation import Array
from dynkit.dynamics.hybrid_flow import HybridFlow
from dynkit.systems.symbolic.flows import SymbolicFlow, take_states


class SymbolicHybridFlow(SymbolicFlow, HybridFlow):
    """A `SymbolicFlow` whose state jumps: guard and reset are expressions, too.

    Besides ``velocity`` a subclass must implement two methods of the same coordinates:

    1. ``guard(self, x, y, ...)`` returns one expression. The state jumps when it falls to zero, if
       it was positive before.
    2. ``reset(self, x, y, ...)`` returns the tuple of coordinates just after the jump.

    It may implement ``armed(self, x, y, ...)``, one expression: where it is not positive, the guard
    is ignored. The fields of the class are parameters of all methods. Called with a state, these
    methods return numbers. Derivatives are exact.

    ``ResetMap(flow, time_limit)`` is the map from one jump to the next, with orbits, multipliers,
    exponents, branches and labels.

    Raises
    ------
    ValueError, TypeError, ImportError
        As `SymbolicFlow`; and when a method does not take the coordinates of ``velocity``.

    Examples
    --------
    A neuron that fires when its potential is one. Each spike increases a fatigue, which decays
    between spikes: its multiplier is exp(-period / decay).

    >>> import numpy as np
    >>> from dynkit import ResetMap, periodic_orbit
    >>> class Neuron(SymbolicHybridFlow):
    ...     current: float = 1.5
    ...     decay: float = 2.0
    ...
    ...     def velocity(self, potential, fatigue):
    ...         return self.current - potential, -fatigue / self.decay
    ...
    ...     def guard(self, potential, fatigue):
    ...         return 1 - potential
    ...
    ...     def reset(self, potential, fatigue):
    ...         return 0, fatigue + 1
    >>> spikes = ResetMap(Neuron(), time_limit=100.0)
    >>> orbit = periodic_orbit(spikes, [0.0, 1.0])
    >>> bool(abs(spikes.return_time(orbit.states[0]) - np.log(3.0)) < 1e-14)
    True
    >>> bool(abs(orbit.multipliers[0] - 3.0 ** -0.5) < 1e-14)
    True
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        scalars = ["guard"] + ["armed"] * (cls.armed is not HybridFlow.armed)
        take_states(cls, scalars, scalar=True)
        take_states(cls, ["reset"], scalar=False)

    def guard_gradient(self, state: Array) -> Array:
        return self._scalar_gradient("guard", state)

    def guard_parameter_derivative(self, state: Array, name: str) -> float:
        return float(self._by_parameter(self._method("guard", scalar=True), state, name)[0])

    def reset_jacobian(self, state: Array) -> Array:
        return self._tangent(self._method("reset"), state)

    def reset_parameter_derivative(self, state: Array, name: str) -> Array:
        return self._by_parameter(self._method("reset"), state, name)
