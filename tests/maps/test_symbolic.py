"""Maps of expressions: machine code against forty digits, derivatives, exponents, refusals."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import mpmath as mp
import numba
import numpy as np
import pytest
import sympy as sp

from dynkit import Map, MapAttractor, Sweep, periodic_orbit, sweep
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.no_motion import Diverged
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.systems import (
    CompiledMap,
    FoldedTowel,
    Henon,
    HighBounce,
    Ikeda,
    Logistic,
    StandardMap,
    SymbolicMap,
)
from dynkit.testing import check_map, numerical_derivative
from tests.maps.symbolic_maps import Everything, Growing, Pieces, Projected, Ring, UserCompiled

ROUNDING = 2.0**-52
POINTS = np.random.default_rng(0).normal(size=(20, 2))


def at(*numbers: float) -> Array:
    return np.array(numbers)


def digits(expressions: Any, values: dict[sp.Symbol, float]) -> Array:
    """SymPy's own values, of 40 digits."""
    exact = {symbol: sp.Float(value, 60) for symbol, value in values.items()}
    return np.array([float(sp.sympify(e).evalf(40, subs=exact)) for e in expressions])


def expressions(system: SymbolicMap) -> tuple[Any, list[sp.Symbol]]:
    """What the method returns, for symbols of its own."""
    names = [*system.parameters]
    symbols = [sp.Symbol(name, real=True) for name in names]
    state = list(sp.symbols(f"s:{system.dimension}", real=True))
    subject: Any = object.__new__(type(system))
    for name, symbol in zip(names, symbols, strict=True):
        object.__setattr__(subject, name, symbol)
    return type(system).next_state(subject, *state), [*state, *symbols]


@cache
def derivatives() -> Any:
    """Next states of `Everything`, each followed by its derivatives, for numbers of mpmath."""
    found, symbols = expressions(Everything())
    return sp.lambdify(symbols, [[e, *(e.diff(s) for s in symbols)] for e in found], "mpmath")


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_next_state_and_derivatives_are_those_of_forty_digits(point: Array) -> None:
    system = Everything()
    with mp.workdps(40):
        values = map(mp.mpf, [*point.tolist(), *system.parameters.values()])
        exact = np.array(derivatives()(*values), dtype=float)
    found, expected, d = exact[:, 0], exact[:, 1:], len(point)
    # some tens of operations, whose terms are below 100 at these points, each rounded
    off = 100.0 * ROUNDING * (1.0 + abs(expected).max() ** 2)
    assert system(point) == pytest.approx(found, abs=off)
    assert system.jacobian(point) == pytest.approx(expected[:, :d], abs=off)
    for i, name in enumerate(system.parameters):
        by_parameter = system.parameter_derivative(point, name)
        assert by_parameter == pytest.approx(expected[:, d + i], abs=off)


@pytest.mark.parametrize("seed", range(20))
def test_steps_and_pieces_are_those_of_sympy(seed: int) -> None:
    state = np.random.default_rng(seed).normal(size=3, scale=2.0)
    found, symbols = expressions(Pieces())
    values = dict(zip(symbols, [*state.tolist(), 1.5], strict=True))
    assert Pieces()(state) == pytest.approx(digits(found, values), rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("seed", range(20))
def test_derivatives_of_steps_are_zero_and_of_pieces_those_of_the_piece(seed: int) -> None:
    state = np.random.default_rng(seed).normal(size=3, scale=2.0)
    found, error = numerical_derivative(Pieces(), state)
    assert (abs(Pieces().jacobian(state) - found) <= 20.0 * error + 1e-12).all()


@pytest.mark.parametrize("divisor", [2.0, -2.0])
@pytest.mark.parametrize("x", [5.0, -5.0, 4.0, -0.5, 1e16, -1e-30])
def test_modulo_is_pythons(x: float, divisor: float) -> None:
    class Wrapped(SymbolicMap):
        by: float = 1.0

        def next_state(self, x: Any) -> tuple[Any, ...]:
            return (sp.Mod(x, self.by),)

    assert Wrapped(by=divisor)(at(x))[0] == x % divisor


@pytest.mark.parametrize(
    "system",
    [Henon(), Ikeda(), FoldedTowel(), StandardMap(), HighBounce(0.5, 3.0), Ring()],
    ids=repr,
)
def test_stretching_is_that_of_the_loop_in_python(system: SymbolicMap) -> None:
    start, n = np.full(system.dimension, 0.1), 12
    fast, slow = system.stretching(start, n), SmoothMap.stretching(system, start, n)
    # few iterates: chaos parts the two, whose next states may be rounded in other orders
    assert fast.logs == pytest.approx(slow.logs, rel=1e-9, abs=1e-9)
    assert fast.errors == pytest.approx(slow.errors, rel=1e-6)
    assert fast.state == pytest.approx(slow.state, rel=1e-9)
    assert fast.times is None


@pytest.mark.plain
def test_a_lost_direction_is_minus_infinity_and_the_others_are_as_without_it() -> None:
    logs = Projected().stretching(at(0.1, 0.1, 0.3), 20).logs
    assert np.isneginf(logs[:, 2]).all()
    assert logs[:, :2] == pytest.approx(Henon().stretching(at(0.1, 0.1), 20).logs, abs=1e-11)


@pytest.mark.plain
def test_iterates_are_calls_and_their_frames_those_of_qr() -> None:
    system, here, frame = FoldedTowel(), at(0.085, -0.121, 0.075), np.eye(3)
    rows = system.iterate(here, 10)
    for i, log in enumerate(system.stretching(here, 10).logs):
        frame, triangle = np.linalg.qr(system.jacobian(rows[i]) @ frame)
        assert log == pytest.approx(np.log(abs(triangle.diagonal())), abs=1e-10)
        assert rows[i + 1].tobytes() == system(rows[i]).tobytes()


def test_huge_and_tiny_derivatives_keep_their_logarithms() -> None:
    class Scaled(SymbolicMap):
        by: float = 1.0

        def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
            return self.by * x, self.by * y / 2

    for size in (1e-140, 1e140):
        logs = Scaled(by=size).stretching(at(0.0, 0.0), 3).logs
        assert logs == pytest.approx(np.tile(np.log([size, size / 2.0]), (3, 1)), rel=1e-14)


# --- numbers of the literature --------------------------------------------------------------------

SPECTRA = {
    # a loop of LAPACK's QR, 4e6 iterates: .43078(13), .37773(22), -3.30173(26)
    "towel": (FoldedTowel(), at(0.085, -0.121, 0.075), [0.4306, 0.3776, -3.3013]),
    # J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003, appendix A: Henon, Ikeda
    "henon": (Henon(), at(0.1, 0.1), [0.41922, -1.62319]),
    "ikeda": (Ikeda(), at(0.1, 0.1), [0.50760, -0.71832]),
}


@pytest.mark.parametrize("name", SPECTRA)
def test_exponents_are_those_of_the_literature(name: str) -> None:
    system, start, expected = SPECTRA[name]
    found = LyapunovSpectrum.of_map(system, start, iterations=1_000_000)
    assert found.resolved
    assert (abs(found.exponents - expected) <= 5.0 * found.error + 5e-5).all()


@pytest.mark.parametrize(
    ("system", "total"),
    [(Henon(b=0.3), np.log(0.3)), (Ikeda(u=0.9), 2.0 * np.log(0.9)), (StandardMap(k=5.0), 0.0)],
    ids=repr,
)
def test_exponents_add_up_to_the_logarithm_of_the_determinant(
    system: SymbolicMap, total: float
) -> None:
    found = LyapunovSpectrum.of_map(system, at(0.1, 0.3), iterations=100_000)
    assert found.sum == pytest.approx(total, abs=1e-13)


@pytest.mark.parametrize("k", [0.0, 0.5, 0.971635, 5.0])
def test_the_standard_map_keeps_areas_and_its_fixed_points_have_greenes_residues(k: float) -> None:
    system = StandardMap(k=k)
    for state in np.random.default_rng(1).uniform(0.0, 6.0, (5, 2)):
        assert np.linalg.det(system.jacobian(state)) == pytest.approx(1.0, abs=8.0 * ROUNDING * 30)
    # J. M. Greene, J. Math. Phys. 20 (1979) 1183: (2 - trace)/4 = k/4 at theta = pi, -k/4 at 0
    for theta, residue in ((np.pi, 0.25 * k), (0.0, -0.25 * k)):
        trace = np.trace(system.jacobian(at(theta, 0.0)))
        assert (2.0 - trace) / 4.0 == pytest.approx(residue, abs=8.0 * ROUNDING)


def test_angles_are_wrapped_to_the_shortest_way() -> None:
    gap = StandardMap().difference(at(6.2, 7.0), np.array([[0.1, 0.0], [3.0, 7.0]]))
    assert gap == pytest.approx(np.array([[6.1 - 2.0 * np.pi, 7.0], [3.2 - 2.0 * np.pi, 0.0]]))


class Circle(SymbolicMap):
    """Arnold's circle map, written without a modulus."""

    angles: ClassVar = ("theta",)
    drift: float = 1.9
    kick: float = 0.5

    def next_state(self, theta: Any) -> tuple[Any, ...]:
        return (theta + self.drift + self.kick * sp.sin(theta),)


class CompiledCircle(CompiledMap):
    angles: ClassVar = ("theta",)
    drift: float = 1.9
    kick: float = 0.5

    @staticmethod
    @numba.njit
    def next_state(theta: Any, drift: Any, kick: Any) -> Any:
        return (theta + drift + kick * np.sin(theta),)


@pytest.mark.parametrize("kind", [Circle, CompiledCircle])
def test_angles_stay_within_one_turn(kind: Any) -> None:
    states = kind().iterate(at(0.1), 1000)
    lifted = np.empty(1001)
    lifted[0] = 0.1
    for i in range(1000):
        lifted[i + 1] = lifted[i] + 1.9 + 0.5 * np.sin(lifted[i])
    assert states.min() >= 0.0
    assert states.max() <= 2.0 * np.pi
    assert kind().difference(states, lifted[:, None]) == pytest.approx(0.0, abs=1e-10)
    assert kind().jacobian(at(3.0)) == pytest.approx(np.array([[1.0 + 0.5 * np.cos(3.0)]]))


@pytest.mark.parametrize("kind", [Circle, CompiledCircle])
@pytest.mark.parametrize("transient", [100, 10_000, 1_000_000])
def test_the_label_of_a_turning_motion_does_not_hang_on_its_turns(
    kind: Any, transient: int
) -> None:
    label = kind().attractor(start=at(0.1), transient=transient).label
    # the mean advance over 1e8 iterates, whose error is about one turn over their number
    assert label.rotation_number == pytest.approx(0.29526251406, abs=2e-8)


@pytest.mark.plain
def test_the_interpreted_step_wraps_angles_too() -> None:
    assert CompiledCircle()(at(6.0)) == pytest.approx(7.9 + 0.5 * np.sin(6.0) - 2.0 * np.pi)


@pytest.mark.parametrize("given", ["xy", (0,), ("z",)])
def test_angles_that_are_no_names_of_coordinates_are_refused(given: Any) -> None:
    class Turned(SymbolicMap):
        angles: ClassVar = given

        def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
            return 2 * x + y, x + y

    limit = f"angles must be a tuple of names of coordinates, x, y; got {given!r}"
    with pytest.raises(ValueError, match=re.escape(limit)):
        Turned().difference(at(0.0, 0.0), at(0.1, 0.0))


# --- one class, its fields and its stores ---------------------------------------------------------


def test_it_is_derived_once_for_all_values_of_its_parameters() -> None:
    calls = []

    class Counted(SymbolicMap):
        rate: float = 3.2

        def next_state(self, x: Any) -> tuple[Any, ...]:
            calls.append(self.rate)
            return (self.rate * x * (1 - x),)

    for rate in np.linspace(2.0, 4.0, 20):
        system = Counted(rate=float(rate))
        assert system(at(0.25))[0] == pytest.approx(rate * 0.1875, rel=4 * ROUNDING)
        system.jacobian(at(0.25))
        system.stretching(at(0.25), 5)
    assert len(calls) == 1


def test_fields_that_are_no_parameters_choose_the_expressions() -> None:
    linear, square = Ring(), Ring(coupling="square")
    assert dict(linear.parameters) == {"rate": 3.7, "strength": 0.1}
    assert linear(at(0.5, 0.5))[1] == pytest.approx(0.925)
    assert square(at(0.5, 0.5))[1] == pytest.approx(0.925 - 0.025)
    assert square.replace(strength=0.0) == Ring(coupling="square", strength=0.0)


def test_a_subclass_builds_on_what_it_inherits() -> None:
    system = Growing(growth=0.25)  # type: ignore[call-arg]
    assert system(at(0.5, 0.5)) - Ring()(at(0.5, 0.5)) == pytest.approx([0.25, 0.0], abs=1e-15)
    assert system.parameter_derivative(at(0.5, 0.5), "growth").tolist() == [1.0, 0.0]


def test_it_can_be_sent_and_stored(tmp_path: Path) -> None:
    system = Growing(growth=0.01)  # type: ignore[call-arg]
    system(at(0.1, 0.2))
    sent = pickle.loads(pickle.dumps(system))
    assert sent == system
    assert sent(at(0.1, 0.2)).tobytes() == system(at(0.1, 0.2)).tobytes()
    file = tmp_path / "sweep.h5"
    found = sweep(
        Ring(rate=3.2), "rate", at(2.5, 2.6), start=[0.3, 0.4], store=file, progress=False
    )
    assert [str(label) for label in found.labels] == ["P(1)", "P(1)"]
    again = Sweep.load(file, system=Ring(rate=3.2))
    assert [str(label) for label in again.labels] == ["P(1)", "P(1)"]


def test_orbits_and_attractors_take_it_as_any_map() -> None:
    orbit = MapAttractor(Henon(a=0.385), at(0.0, 0.0), 500, 100).periodic_orbit()
    assert orbit.label == "P(2)"
    assert periodic_orbit(Ikeda(u=0.4), np.array([[1.1, 0.2]])).residual < 1e-14


def test_it_keeps_the_contract() -> None:
    check_map(Growing(growth=0.02), np.array([[0.2, 0.4], [0.7, 0.1]]))  # type: ignore[call-arg]
    check_map(Ring(), np.array([[0.3, 0.4], [0.9, 0.1]]))


def test_where_it_runs_away_is_named() -> None:
    with pytest.raises(Diverged, match=r"state\[0\] is -inf after 10 iterates"):
        Logistic(rate=4.0).stretching(at(1.5), 100)
    assert np.isinf(Logistic(rate=4.0)(at(1e200))).all()


def test_the_first_use_takes_no_compiler_of_its_own() -> None:
    """In a process of its own: the kernels are cached, and code of a class takes milliseconds."""
    code = (
        "from dynkit.systems import Henon; Henon().stretching([0.1, 0.1], 10);"
        "from dynkit.systems.symbolic import kernels as k;"
        "print(sum(k.stretch.stats.cache_misses.values()))"
    )
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout.split() == [b"0"]


# --- a user's own compiler ------------------------------------------------------------------------


def test_a_users_own_compiled_step_is_the_map() -> None:
    system: Map = UserCompiled(a=1.2)
    rows = system.iterate(at(0.1, 0.1), 100)
    assert rows[:15] == pytest.approx(Henon(a=1.2).iterate(at(0.1, 0.1), 14), rel=1e-9)
    check_map(system, rows[:3])
    assert pickle.loads(pickle.dumps(system)) == system


class WrongCount(CompiledMap):
    """One number for two coordinates."""

    @staticmethod
    @numba.njit
    def next_state(x: float, y: float) -> tuple[float, ...]:
        return (x + y,)


class WrongOrder(CompiledMap):
    """Parameters in another order than the fields."""

    a: float = 1.0
    b: float = 1.0

    @staticmethod
    @numba.njit
    def next_state(x: float, b: float, a: float) -> tuple[float, ...]:
        return (a * b * x,)


class NotCompiled(CompiledMap):
    """Plain Python."""

    @staticmethod
    def next_state(x: float) -> tuple[float, ...]:
        return (x,)


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        (WrongCount, ValueError, "WrongCount.next_state must return a tuple of 2 numbers"),
        (WrongOrder, TypeError, "must take coordinates, then a, b; got x, b, a"),
        (NotCompiled, TypeError, "must be a static method that numba.njit compiles"),
    ],
)
def test_a_compiled_step_that_does_not_fit_is_refused(
    kind: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        kind()(np.zeros(2 if kind is WrongCount else 1))


# --- refusals -------------------------------------------------------------------------------------


def _two(function: Any) -> SymbolicMap:
    class Bad(SymbolicMap):
        a: float = 1.0

        def next_state(self, x: Any, y: Any) -> Any:
            return function(self, x, y)

    return Bad()


REFUSED: dict[str, tuple[Any, type[Exception], str]] = {
    "too few": (lambda s, x, y: (x,), ValueError, "must return 2 expressions, one for each coor"),
    "too many": (lambda s, x, y: (x, y, x), ValueError, "must return 2 expressions.*got 3"),
    "no tuple": (lambda s, x, y: x + y, ValueError, "must return a tuple of 2 expressions; got x"),
    "nothing": (lambda s, x, y: None, ValueError, "must return a tuple of 2 expressions; got None"),
    "a word": (lambda s, x, y: (x, "y"), ValueError, "result 1 must be an expression; got 'y'"),
    "a truth": (
        lambda s, x, y: (x, x > y),
        ValueError,
        "result 1 must be an expression; got x > y",
    ),
    "another symbol": (
        lambda s, x, y: (x, sp.Symbol("q")),
        ValueError,
        "result 1 must hold coordinates and fields only; got q",
    ),
    "a function without code": (
        lambda s, x, y: (x, sp.gamma(y)),
        ValueError,
        "must be made of functions that can be compiled; got gamma",
    ),
    "a function of its own": (
        lambda s, x, y: (x, sp.Function("f")(y)),
        ValueError,
        "must be made of functions that can be compiled; got f",
    ),
    "a complex number": (
        lambda s, x, y: (x, sp.I * y),
        ValueError,
        "must be real and finite; got I",
    ),
    "infinity": (lambda s, x, y: (x, y + sp.oo), ValueError, "must be real and finite; got oo"),
    "a huge number": (
        lambda s, x, y: (x, y * 10**400),
        ValueError,
        "must be real and finite; got 1",
    ),
    "a comparison": (
        lambda s, x, y: (x, y if x > 0 else -y),
        TypeError,
        "must not compare symbols.*Piecewise",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_map_is_refused(name: str) -> None:
    function, error, message = REFUSED[name]
    with pytest.raises(error, match=message):
        _two(function)(np.zeros(2))


def test_numbers_of_another_library_are_explained() -> None:
    with pytest.raises(TypeError) as fault:
        _two(lambda s, x, y: (np.sin(x), y))(np.zeros(2))
    assert "use sympy.sin" in "".join(fault.value.__notes__)


def test_a_coordinate_with_the_name_of_a_field_is_refused() -> None:
    class Twice(SymbolicMap):
        x: float = 1.0

        def next_state(self, x: Any) -> tuple[Any, ...]:
            return (x,)

    with pytest.raises(TypeError, match="must not name a coordinate as a field; got x"):
        Twice()(at(1.0))


def test_arguments_without_a_name_are_refused() -> None:
    class Starred(SymbolicMap):
        def next_state(self, *x: Any) -> tuple[Any, ...]:
            return x

    with pytest.raises(TypeError, match=r"must name its coordinates, as in \(self, x, y\)"):
        Starred()(at(1.0))


def test_a_map_without_a_next_state_cannot_be_made() -> None:
    class Nothing(SymbolicMap):
        a: float = 1.0

    with pytest.raises(TypeError, match=r"abstract method .?next_state"):
        Nothing()
