"""Equilibria of flows, and their equations."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import permutations
from typing import Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, finite_array, of_type, one_of
from dynkit.dynamics.flow import Flow, flow_coordinates
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane, PoincareSection, Stroboscope
from dynkit.orbits.equations import KeptSolution, Problem, ProblemSolution
from dynkit.orbits.families import FamilyProblem, FamilySolution, solution_near
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.map_problem import MapProblem, sizes
from dynkit.orbits.newton import NoConvergence, NoSolution
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
_RETURN, _STEPS = 10.0, 8


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
    returns = PoincareMap(flow, section, _RETURN * 2.0 * np.pi / frequency)
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


_ROUNDING = 2.0**-52
# Time limit of a return to the section, in periods of the Hopf point.
_PERIODS = 10.0
# A periodic orbit is a small oscillation about an equilibrium if an eigenvalue of the equilibrium
# differs from 2 pi i / period by at most _SMALL, relative. _SHOWN is the number of samples of each
# return, from which its middle and its size are computed.
_SMALL, _SHOWN = 1e-5, 33
# Smallest amplitude of an oscillation, relative to the size of the state: below it rounding
# dominates the return map.
_LEAST = 1e-4
# Units of the equations at a far guess hide residuals. Where a unit at the solution is less than
# _COARSE times that at the guess, the solution is the next guess, at most _REPEATS times.
_COARSE, _REPEATS = 0.1, 20


@final
class EquilibriumProblem(FamilyProblem):
    """velocity(x) = 0: d equations for the state of an equilibrium of a flow.

    The unit of each equation is the sum of the magnitudes of its terms at a state.

    Parameters
    ----------
    flow : Flow
    state : (d,) array
        A state near the solutions.
    names : sequence of str
        The free parameters.

    Raises
    ------
    ValueError
        When the flow has no such parameter.
    """

    _stored: ClassVar = ("_sizes", "_units")
    _given: ClassVar = "_system"
    _sizes: Array
    _units: Array

    def __init__(self, flow: Flow, state: Array, names: Sequence[str] = ()) -> None:
        super().__init__(flow, names)
        self._sizes = sizes(state[None])
        self._units = np.ones(len(state))
        units = abs(self._jacobian(state, self.values)[0]) @ self._sizes
        self._units[units > 0.0] = units[units > 0.0]

    def _restored(self) -> Self:
        if not self._sizes.shape == self._units.shape == (self._system.dimension,):
            raise ValueError(f"sizes {self._sizes.shape} and units {self._units.shape} do not fit")
        return self.free()

    @property
    def label(self) -> str:
        return "equilibrium"

    @property
    def size(self) -> int:
        return len(self._sizes)

    def scale(self, x: Array) -> Array:
        # at least the sizes of the given state: a branch through the state zero keeps its step size
        return np.maximum(sizes(x[None]), self._sizes)

    def residual(self, x: Array, p: Array) -> Array:
        return np.asarray(_defined(self.at(p).velocity, x) / self._units)

    def rounding(self, x: Array, p: Array) -> Array:
        """Return sixteen roundings of the sum of the magnitudes of each equation's terms, (d,)."""
        terms = abs(self._jacobian(x, p)[0]) @ abs(x) / self._units
        return np.asarray(16.0 * _ROUNDING * np.maximum(1.0, terms))

    def linearization(self, x: Array, p: Array) -> Any:
        return self._jacobian(x, p)[0] / self._units[:, None]

    def linearization_error(self, x: Array, p: Array) -> Any:
        if not self.at(p)._velocity_by_differences:
            return 0.0
        return self._jacobian(x, p)[1] / self._units[:, None]

    def pencil(self, x: Array, p: Array, value: complex) -> Any:
        """Return the velocity's derivative minus the value, in the units of the equations."""
        return self.linearization(x, p) - np.diag(value / self._units)

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        by_name = partial(self.at(p).velocity_parameter_derivative, x)
        columns = [_defined(by_name, name) / self._units for name in self.names]
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Return the velocity's derivative, (1, d, d), and the error of its entries, (1,)."""
        matrix, off = self._jacobian(x, p)
        return matrix[None], np.array([4.0 * _ROUNDING * abs(matrix).max() + off.max()])

    def observables(self, x: Array) -> Mapping[str, Array]:
        return flow_coordinates(x[None])

    def made(self, x: Array, history: Sequence[float], cost: Cost) -> Equilibrium:
        return Equilibrium(self, x, history, cost)

    def oscillation(
        self, x: Array, p: Array, frequency: float, mode: Any
    ) -> tuple[Problem, Array, Array] | None:
        """Return the return map on a plane through a Hopf point, and the direction of its orbits.

        The plane contains the tangent of the branch of equilibria, and the oscillation crosses it.
        On it the orbit of amplitude a is the Hopf point plus a times the direction.

        Returns
        -------
        problem : MapProblem
            Fixed points of the return map.
        place, direction : (d - 1,) arrays
            The Hopf point and the direction in coordinates of the section.

        References
        ----------
        Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 4th ed., Springer 2023, section 3.4
        and 10.2.
        """
        flow, plane = self.at(p), np.linalg.qr(np.column_stack([mode.real, mode.imag]))[0]
        along = np.linalg.solve(self.linearization(x, p), self.parameter_derivative(x, p))[:, 0]
        slope = plane.T @ along
        length = float(np.linalg.norm(slope))
        turned = np.array([-slope[1], slope[0]]) / length if length else np.array([1.0, 0.0])
        normal = plane @ turned
        section = Hyperplane(normal, float(normal @ x))
        size = float(abs(x).max()) or 1.0
        limit, least = _PERIODS * 2.0 * np.pi / frequency, _LEAST * size * frequency
        returns = PoincareMap(flow, section, limit, least)
        place, like = section.reduce(x), np.full((1, section.dimension - 1), size)
        direction = section.reduce_derivative(x) @ crossing(mode, normal)
        return MapProblem(returns, like, self.names), place, direction

    def _jacobian(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Return the velocity's derivative, (d, d), and its error beyond rounding, (d, d)."""
        flow = self.at(p)
        if flow._velocity_by_differences:
            matrix, off = _defined(flow._velocity_differences, x)
            return matrix, off
        matrix = _defined(flow.velocity_jacobian, x)
        return matrix, np.zeros_like(matrix)


def _defined(function: Callable[[Any], Any], argument: Any) -> Any:
    """Return the value of a function, if it is finite; otherwise raise `NoSolution`."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = function(argument)
    if not np.isfinite(found).all():
        raise NoSolution(f"the flow is not finite at {argument}")
    return found


@final
class Equilibrium(FamilySolution):
    """An equilibrium of a flow, stable or unstable: a state with zero velocity.

    It is made by `equilibrium` or taken from a branch. It is always admissible; its label is
    ``equilibrium``.
    """

    _stored: ClassVar = KeptSolution._stored
    _given: ClassVar = None
    _problem: EquilibriumProblem

    @classmethod
    def load(cls, path: str | os.PathLike[str], system: Flow) -> Self:
        return super(FamilySolution, cls).load(path, system)

    @property
    def state(self) -> Array:
        """The state, (d,), read-only."""
        return self.unknowns

    def lyapunov_orbits(
        self, integral: str, section: PoincareSection | None = None
    ) -> list[MapOrbit]:
        """Return a small orbit of each family that emanates from a centre of a conservative flow.

        Each pair of imaginary eigenvalues has a family of periodic orbits, whose periods tend to
        that of the linear oscillation (Lyapunov's centre theorem). `continue_orbit` follows it with
        the value of the integral as its parameter. The orbits have an amplitude of a hundredth of
        the state's size, or of one where the state is zero.

        Parameters
        ----------
        integral : str
            One of the flow's `integrals`.
        section : PoincareSection, optional
            A section through the equilibrium that the oscillation crosses. By default a plane on
            which one coordinate has its value at the equilibrium: the first coordinate whose
            amplitude is at least a third of the largest one.

        Returns
        -------
        list of MapOrbit
            In the order of frequencies, the largest first.

        Raises
        ------
        ValueError
            When the flow has no such integral, or a frequency is a multiple of another one: more
            families, or fewer, may then emanate.
        NoConvergence
            When Newton's method does not converge to an orbit.

        References
        ----------
        K. R. Meyer, D. C. Offin, Introduction to Hamiltonian Dynamical Systems and the N-Body
        Problem, 3rd ed., Springer 2017, section 9.2.
        """
        return small_orbits(self.system, self.state, integral, section)


def equilibrium(flow: Flow, guess: Any) -> Equilibrium:
    """Find an equilibrium of a flow, stable or unstable, by Newton's method from a guess.

    Parameters
    ----------
    flow : Flow
        Newton's method uses its `velocity_jacobian`, by default differences.
    guess : (d,) array_like
        A state near the equilibrium.

    Returns
    -------
    Equilibrium
        `continue_orbit` follows it as one parameter changes.

    Raises
    ------
    ValueError
        When the flow is not a `Flow`, or the guess is not finite or has another shape.
    NoConvergence
        When Newton's method does not converge to an equilibrium.

    Examples
    --------
    >>> from dynkit import continue_orbit
    >>> from dynkit.systems import Lorenz
    >>> found = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    >>> found.state.round(6), found.stable
    (array([ 6.110101,  6.110101, 14.      ]), True)
    >>> branch = continue_orbit(found, "rho", bounds=(0.5, 30.0))
    >>> [(b.kind.value, round(b.value, 9)) for b in branch.bifurcations if b.kind == "HB"]
    [('HB', 24.736842105), ('HB', 24.736842105)]
    """
    of_type("flow", flow, Flow, "a Flow")
    start = finite_array("guess", guess, (flow.dimension,))
    near, cost = _near(flow, start), Cost(0.0)
    history: tuple[float, ...] = ()
    for _ in range(_REPEATS):
        found, units = solution_near(near, start), near._units
        start, cost = found.unknowns, cost + found.cost
        history += found.history[min(len(history), 1) :]
        near = _near(flow, start)
        if (near._units >= _COARSE * units).all():
            break
    return near.made(start, history, cost)


def shrinks(orbit: ProblemSolution) -> bool:
    """Whether a periodic orbit of a flow is a small oscillation about an equilibrium."""
    if not (isinstance(orbit, MapOrbit) and isinstance(system := orbit.system, PoincareMap)):
        return False
    if isinstance(system.section, Stroboscope):
        return False
    try:
        states = np.concatenate([system._path(at, _SHOWN)[1][1:] for at in orbit.states])
        middle = states.mean(axis=0)
        found = equilibrium(system.flow, middle)
    except (NoMotion, NoConvergence):
        return False
    turning = 2.0j * np.pi / orbit.duration
    size = abs(states - middle).max(axis=0)
    near = (abs(found.state - middle) <= size + found.error).all()
    return bool(near and abs(found.eigenvalues - turning).min() <= _SMALL * abs(turning))


def _near(flow: Flow, state: Array) -> EquilibriumProblem:
    try:
        return EquilibriumProblem(flow, state)
    except NoMotion as refusal:
        raise NoConvergence(f"no equilibrium found from the guess: {refusal}") from refusal
