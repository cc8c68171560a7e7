"""Conformance checks: whether a subclass keeps the contract of its base class.

Each check is a function that asserts one property and raises AssertionError, which names it. They
stand in tuples, for pytest::

    @pytest.mark.parametrize("check", map_checks, ids=check_name)
    def test_my_map_conforms(check):
        check(MyMap(), states)

or run at once: ``check_map(MyMap(), states)``. States are the rows of an array, some five of them,
where the system is smooth. Derivatives are compared with differences, within the error that these
estimate of themselves; states of flows, which may be integrated, within 1e-7, relative.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from dynkit.attractors import Attractor
from dynkit.flows import Flow, NoCrossing
from dynkit.maps import Map
from dynkit.sections import Hyperplane, PoincareMap, PoincareSection
from dynkit.validation import Array

VectorFunction: TypeAlias = Callable[[Array], Array]
MapCheck: TypeAlias = Callable[[Map, Array], None]
FlowCheck: TypeAlias = Callable[[Flow, Array], None]
SectionCheck: TypeAlias = Callable[[PoincareSection, Array], None]
PoincareMapCheck: TypeAlias = Callable[[PoincareMap, Array], None]
MakeAttractor: TypeAlias = Callable[[int, int], Attractor]
AttractorCheck: TypeAlias = Callable[[MakeAttractor], None]

_FLOW_ACCURACY = 1e-7
_DURATION = 0.5


def check_name(check: Callable[..., None]) -> str:
    """Return the name of a check, for pytest's ids."""
    return check.__name__.replace("_", " ")


def numerical_derivative(
    function: VectorFunction,
    point: Array,
    *,
    step: float = 1e-3,
    difference: Callable[[Array, Array], Array] = np.subtract,
) -> tuple[Array, Array]:
    """Differentiate by central differences, extrapolated to step zero.

    Parameters
    ----------
    function : callable, (d,) array to (m,) array
    point : (d,) array
    step : float
        First step, relative to the point's largest coordinate; it is halved four times.
    difference : callable
        Difference of two values, for values that hold angles.

    Returns
    -------
    derivative : (m, d) array
    error : (m, d) array
        Estimate of its error: how much the last extrapolation changed it, and rounding.

    References
    ----------
    C. J. F. Ridders, Accurate computation of F'(x) and F'(x)F''(x), Advances in Engineering
    Software 4 (1982) 75-76.

    Examples
    --------
    >>> derivative, error = numerical_derivative(np.exp, np.array([1.0]))
    >>> bool(abs(derivative[0, 0] - np.e) < 10 * error[0, 0] < 1e-9)
    True
    """
    columns = []
    largest = float(np.abs(point).max(initial=0.0)) or 1.0
    for k in range(len(point)):
        best, error = np.empty(0), np.empty(0)
        previous: list[Array] = []
        for halving in range(5):
            ahead, behind = point.copy(), point.copy()
            ahead[k] += step * largest / 2.0**halving
            behind[k] -= step * largest / 2.0**halving
            width = ahead[k] - behind[k]
            values = function(ahead), function(behind)
            row = [np.asarray(difference(*values)) / width]
            rounding = 2.0**-52 * np.abs(values).max(initial=0.0) / width
            for order, coarse in enumerate(previous, start=1):
                row.append(row[-1] + (row[-1] - coarse) / (4.0**order - 1.0))
                change = np.maximum(abs(row[-1] - row[-2]), abs(row[-1] - coarse)) + rounding
                if not best.size:
                    best, error = row[-1], change
                better = change < error
                best, error = np.where(better, row[-1], best), np.where(better, change, error)
            previous = row
        columns.append((best, error))
    return (
        np.stack([column for column, _ in columns], axis=1),
        np.stack([error for _, error in columns], axis=1),
    )


# ------------------------------------------------------------------------------- maps


def next_state_has_the_shape(system: Map, states: Array) -> None:
    """The next state of (d,) is finite, of floats, and (d,)."""
    for state in states:
        _require_shape("the next state", system(state), (system.dimension,))


def jacobian_has_the_shape(system: Map, states: Array) -> None:
    """The jacobian is finite, of floats, and (d, d)."""
    for state in states:
        _require_shape("the jacobian", system.jacobian(state), (system.dimension,) * 2)


def map_is_pure(system: Map, states: Array) -> None:
    """The same state gives the same bits, and stays as it was."""
    _require_pure("the call", system, states)
    _require_pure("the jacobian", system.jacobian, states)


def map_refuses_bad_states(system: Map, states: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    _require_refusal("the call", system, states[0])
    _require_refusal("the jacobian", system.jacobian, states[0])


def jacobian_is_the_derivative(system: Map, states: Array) -> None:
    """The jacobian equals differences of the call."""
    for state in states:
        _require_derivative(
            "the jacobian", system.jacobian(state), system, state, difference=system.difference
        )


def iterate_repeats_the_call(system: Map, states: Array) -> None:
    """Rows of `iterate` are, bit for bit, repeated calls."""
    for state in states:
        rows = system.iterate(state, 3)
        expected = [np.asarray(state, dtype=np.float64)]
        for _ in range(3):
            expected.append(system(expected[-1]))
        _require(_same_bits(rows, np.array(expected)), "iterate repeats the call", f"at {state}")


def difference_is_antisymmetric(system: Map, states: Array) -> None:
    """The difference changes sign with its arguments, is zero for equal ones, and broadcasts."""
    rows = system.difference(states, states[0])
    _require_shape("the difference of rows", rows, states.shape)
    for i, state in enumerate(states):
        one = system.difference(state, states[0])
        other = system.difference(states[0], state)
        _require(bool((one == -other).all()), "the difference is antisymmetric", f"at {state}")
        _require(_same_bits(one, rows[i]), "the difference goes row by row", f"at {state}")
        itself = system.difference(state, state)
        _require(not itself.any(), "the difference of equal states is zero", f"got {itself}")


def replace_changes_what_is_named(system: Map, states: Array) -> None:
    """`replace` gives the same map for the same values, and refuses names it does not know."""
    before = dict(system.parameters)
    for name, value in before.items():
        same = system.replace(**{name: value})
        _require(
            type(same) is type(system) and dict(same.parameters) == before,
            "replace keeps what is not named",
            f"{name}: {before} became {dict(same.parameters)}",
        )
        _require(_same_bits(same(states[0]), system(states[0])), "replace keeps the map", f"{name}")
    try:
        system.replace(**{"no such parameter": 1.0})
    except ValueError:
        return
    _require(False, "replace refuses unknown names with ValueError", "it did not")


map_checks: tuple[MapCheck, ...] = (
    next_state_has_the_shape,
    jacobian_has_the_shape,
    map_is_pure,
    map_refuses_bad_states,
    jacobian_is_the_derivative,
    iterate_repeats_the_call,
    difference_is_antisymmetric,
    replace_changes_what_is_named,
)


def check_map(system: Map, states: Array) -> None:
    """Run a map through every one of `map_checks`, at states (k, d)."""
    for check in map_checks:
        check(system, states)


# ------------------------------------------------------------------------------- flows


def flow_results_have_the_shape(flow: Flow, states: Array) -> None:
    """Velocity, advanced state and derivative are finite and of their shapes."""
    d = flow.dimension
    for state in states:
        _require_shape("the velocity", flow.velocity(state), (d,))
        _require_shape("the advanced state", flow.advance(state, _DURATION), (d,))
        _require_shape("the derivative", flow.derivative(state, _DURATION), (d, d))


def flow_is_pure(flow: Flow, states: Array) -> None:
    """The same state gives the same bits, and stays as it was."""
    for name, function in _functions(flow):
        _require_pure(name, function, states)


def flow_refuses_bad_states(flow: Flow, states: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    for name, function in _functions(flow):
        _require_refusal(name, function, states[0])


def advance_composes(flow: Flow, states: Array) -> None:
    """To advance by nothing changes nothing; to advance twice is to advance by the sum."""
    for state in states:
        _require_close("advance by zero", flow.advance(state, 0.0), state, _FLOW_ACCURACY)
        twice = flow.advance(flow.advance(state, _DURATION), 0.7 * _DURATION)
        once = flow.advance(state, 1.7 * _DURATION)
        _require_close("advance twice", twice, once, _FLOW_ACCURACY)


def velocity_is_the_rate_of_advance(flow: Flow, states: Array) -> None:
    """The velocity equals differences, in time, of the advanced state."""
    for state in states:
        velocity = flow.velocity(flow.advance(state, _DURATION))
        path = partial(_path, flow, state)
        _require_derivative("the velocity", velocity[:, None], path, np.array([_DURATION]))


def flow_derivative_is_the_derivative(flow: Flow, states: Array) -> None:
    """The derivative equals differences of the advanced state."""
    for state in states:
        _require_derivative(
            "the flow's derivative",
            flow.derivative(state, _DURATION),
            lambda start: flow.advance(start, _DURATION),
            state,
        )


flow_checks: tuple[FlowCheck, ...] = (
    flow_results_have_the_shape,
    flow_is_pure,
    flow_refuses_bad_states,
    advance_composes,
    velocity_is_the_rate_of_advance,
    flow_derivative_is_the_derivative,
)


def check_flow(flow: Flow, states: Array) -> None:
    """Run a flow through every one of `flow_checks`, at states (k, d)."""
    for check in flow_checks:
        check(flow, states)


# ------------------------------------------------------------------------------- sections


def section_has_dimension_and_direction(section: PoincareSection, points: Array) -> None:
    """The points have one coordinate less than the states; the direction is +1 or -1."""
    found = points.shape[1] + 1
    _require(section.dimension == found, f"the dimension is {found}", f"got {section.dimension}")
    _require(section.direction in (1, -1), "the direction is a sign", f"got {section.direction}")


def lift_lands_on_the_section(section: PoincareSection, points: Array) -> None:
    """Lifted points have value zero."""
    for point in points:
        state = section.lift(point)
        _require_shape("the lifted state", state, (section.dimension,))
        reach = float(np.linalg.norm(section.gradient(state)) * (1.0 + np.linalg.norm(state)))
        off = abs(section.value(state))
        _require(off <= 1e-13 * reach, "lift lands on the section", f"the value is {off}")


def reduce_inverts_lift(section: PoincareSection, points: Array) -> None:
    """`reduce` gives lifted points back."""
    for point in points:
        _require_close("reduce after lift", section.reduce(section.lift(point)), point, 1e-12)


def section_is_pure(section: PoincareSection, points: Array) -> None:
    """The same state gives the same bits, and stays as it was."""
    states = np.array([section.lift(point) for point in points])
    for name, function, on_points in _section_functions(section):
        _require_pure(name, function, points if on_points else states)


def section_refuses_bad_states(section: PoincareSection, points: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    for name, function, on_points in _section_functions(section):
        _require_refusal(name, function, points[0] if on_points else section.lift(points[0]))


def section_derivatives_are_right(section: PoincareSection, points: Array) -> None:
    """The gradient, and the derivatives of the chart, equal differences."""

    def value(state: Array) -> Array:
        return np.array([section.value(state)])

    for point in points:
        state = section.lift(point)
        _require_derivative("the gradient", section.gradient(state)[None], value, state)
        reduced = section.reduce_derivative(state)
        _require_derivative("the derivative of reduce", reduced, section.reduce, state)
        lifted = section.lift_derivative(point)
        _require_derivative("the derivative of lift", lifted, section.lift, point)


section_checks: tuple[SectionCheck, ...] = (
    section_has_dimension_and_direction,
    lift_lands_on_the_section,
    reduce_inverts_lift,
    section_is_pure,
    section_refuses_bad_states,
    section_derivatives_are_right,
)


def check_section(section: PoincareSection, points: Array) -> None:
    """Run a section through every one of `section_checks`, at reduced points (k, d - 1)."""
    for check in section_checks:
        check(section, points)


# ------------------------------------------------------------------------------- Poincare maps


def crossing_lands_on_the_section(system: PoincareMap, states: Array) -> None:
    """Where the flow crosses, the section's value is zero."""
    for state in states:
        hit = system.crossing(state).state
        reach = float(np.linalg.norm(system.section.gradient(hit)) * (1.0 + np.linalg.norm(hit)))
        off = abs(system.section.value(hit))
        _require(
            off <= _FLOW_ACCURACY * reach, "crossings lie on the section", f"the value is {off}"
        )


def crossing_goes_in_the_direction(system: PoincareMap, states: Array) -> None:
    """Where the flow crosses, it raises the section's value, or lowers it, as the section says."""
    for state in states:
        hit = system.crossing(state).state
        rate = float(system.section.gradient(hit) @ system.flow.velocity(hit))
        _require(
            rate * system.section.direction > 0.0,
            "crossings go in the section's direction",
            f"the value changes at the rate {rate}",
        )


def crossing_is_where_the_flow_is(system: PoincareMap, states: Array) -> None:
    """The return time is positive, and the flow advanced by it is at the crossing."""
    for state in states:
        hit = system.crossing(state)
        _require(hit.time > 0.0, "return times are positive", f"got {hit.time}")
        there = system.flow.advance(system.section.lift(state), hit.time)
        _require_close("the flow at the return time", there, hit.state, _FLOW_ACCURACY)


def crossing_is_the_first(system: PoincareMap, states: Array) -> None:
    """No passage in the section's direction, in 200 samples, comes before the crossing."""
    for state in states:
        start = system.section.lift(state)
        times = np.linspace(0.0, system.return_time(state), 200)[1:-1]
        values = [system.section.value(system.flow.advance(start, t)) for t in times]
        side = system.section.direction * np.array(values) > 0.0
        early = times[1:][side[1:] & ~side[:-1]]
        _require(not early.size, "crossings are the first", f"one was missed before {early[:1]}")


def time_limit_is_kept(system: PoincareMap, states: Array) -> None:
    """With half the return time as time limit, `NoCrossing` is raised."""
    for state in states:
        try:
            replace(system, time_limit=0.5 * system.return_time(state))(state)
        except NoCrossing:
            continue
        _require(False, "NoCrossing is raised at the time limit", f"it was not from {state}")


poincare_map_checks: tuple[PoincareMapCheck, ...] = (
    crossing_lands_on_the_section,
    crossing_goes_in_the_direction,
    crossing_is_where_the_flow_is,
    crossing_is_the_first,
    time_limit_is_kept,
)


def check_poincare_map(system: PoincareMap, states: Array) -> None:
    """Run a Poincare map through `poincare_map_checks` and `map_checks`, at states (k, d - 1)."""
    for check in (*poincare_map_checks, *map_checks):
        check(system, states)


# ------------------------------------------------------------------------------- attractors


def attractor_states_have_the_shape(make: MakeAttractor) -> None:
    """As many states are kept, and skipped, as were asked for; they are finite and read-only."""
    attractor = make(7, 20)
    _require_shape("the states", attractor.states, (20, attractor.system.dimension))
    _require(attractor.transient == 7, "the transient is kept", f"got {attractor.transient}")
    _require(not attractor.states.flags.writeable, "the states are read-only", "they are not")


def attractor_is_deterministic(make: MakeAttractor) -> None:
    """The same attractor has the same states, label and error, bit for bit."""
    one, other = make(7, 100), make(7, 100)
    _require(_same_bits(one.states, other.states), "the states are deterministic", "they differ")
    for name in ("label", "error"):
        values = getattr(one, name), getattr(other, name)
        _require(values[0] == values[1], f"the {name} is deterministic", f"got {values}")


def transient_skips_states(make: MakeAttractor) -> None:
    """A longer transient gives, bit for bit, the later states."""
    later, all_states = make(7, 20).states, make(0, 27).states
    _require(_same_bits(later, all_states[7:]), "the transient skips states", "others are left")


def time_series_does_not_depend_on_company(make: MakeAttractor) -> None:
    """Times give the same bits together and one by one, in any order."""
    attractor, times = make(7, 20), np.array([30.0, 0.0, 5.0])
    together = attractor.time_series(times)
    for i, time in enumerate(times):
        alone = make(7, 20).time_series(np.array([time]))[0]
        _require(_same_bits(together[i], alone), "times give the same bits alone", f"at {time}")


def attractor_has_sections(make: MakeAttractor) -> None:
    """Where a plane divides the states, the points on the section are finite and (k, d)."""
    attractor = make(7, 100)
    d = attractor.system.dimension
    if d > 1:  # a point divides a line, but has no coordinates
        middle = float(attractor.states[:, 0].mean())
        points = attractor.section(Hyperplane(np.eye(d)[0], middle))
        _require_shape("the section", points, (len(points), d))


def attractor_says_cost_and_error(make: MakeAttractor) -> None:
    """The cost's seconds and the error are not negative, and the error is no NaN."""
    attractor = make(7, 20)
    _require(attractor.cost.seconds >= 0.0, "the cost is not negative", f"{attractor.cost}")
    _require(attractor.error >= 0.0, "the error is not negative", f"got {attractor.error}")


attractor_checks: tuple[AttractorCheck, ...] = (
    attractor_states_have_the_shape,
    attractor_is_deterministic,
    transient_skips_states,
    time_series_does_not_depend_on_company,
    attractor_has_sections,
    attractor_says_cost_and_error,
)


def check_attractor(make: MakeAttractor) -> None:
    """Run an attractor through every one of `attractor_checks`.

    Parameters
    ----------
    make : callable
        Makes the attractor of one and the same motion: ``make(transient, states)``.
    """
    for check in attractor_checks:
        check(make)


# ------------------------------------------------------------------------------- what they share


def _functions(flow: Flow) -> list[tuple[str, VectorFunction]]:
    return [
        ("the velocity", flow.velocity),
        ("the advanced state", lambda state: flow.advance(state, _DURATION)),
        ("the flow's derivative", lambda state: flow.derivative(state, _DURATION)),
    ]


def _path(flow: Flow, start: Array, time: Array) -> Array:
    return flow.advance(start, float(time[0]))


def _section_functions(section: PoincareSection) -> list[tuple[str, VectorFunction, bool]]:
    return [
        ("the value", lambda state: np.array(section.value(state)), False),
        ("the gradient", section.gradient, False),
        ("reduce", section.reduce, False),
        ("the derivative of reduce", section.reduce_derivative, False),
        ("lift", section.lift, True),
        ("the derivative of lift", section.lift_derivative, True),
    ]


def _require(condition: bool, what: str, detail: str) -> None:
    if not condition:
        raise AssertionError(f"{what}: {detail}")


def _same_bits(a: Array, b: Array) -> bool:
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def _require_shape(name: str, array: Array, shape: tuple[int, ...]) -> None:
    found = np.asarray(array)
    _require(found.shape == shape, f"{name} has shape {shape}", f"got {found.shape}")
    _require(found.dtype == np.float64, f"{name} holds floats", f"got {found.dtype}")
    _require(bool(np.isfinite(found).all()), f"{name} is finite", f"got {found}")


def _require_close(name: str, found: Array, expected: Array, accuracy: float) -> None:
    off = float(np.abs(found - expected).max(initial=0.0))
    allowed = accuracy * (1.0 + float(np.abs(expected).max(initial=0.0)))
    _require(off <= allowed, name, f"got {found}, which is {off} away from {expected}")


def _require_pure(name: str, function: VectorFunction, arguments: Array) -> None:
    for argument in arguments:
        given = argument.copy()
        first = function(given)
        kept = np.array(first)
        second = function(given)
        _require(_same_bits(given, argument), f"{name} leaves its argument", f"{given}")
        _require(not np.shares_memory(first, given), f"{name} is a new array", "it is a view")
        same = _same_bits(kept, np.asarray(first)) and _same_bits(kept, np.asarray(second))
        _require(same, f"{name} is pure", f"got {kept}, then {second}, at {argument}")


def _require_refusal(name: str, function: VectorFunction, good: Array) -> None:
    for wrong in (np.nan, np.inf):
        bad = good.copy()
        bad[-1] = wrong
        _require(_refused(function, bad), f"{name} refuses {wrong} with ValueError", "it did not")
    longer = np.append(good, 0.0)
    _require(_refused(function, longer), f"{name} refuses a wrong shape with ValueError", "no")


def _refused(function: VectorFunction, argument: Array) -> bool:
    try:
        function(argument)
    except ValueError:
        return True
    except Exception:  # of whatever kind: it is not the one that was promised
        return False
    return False


def _require_derivative(
    name: str,
    claimed: Array,
    function: VectorFunction,
    point: Array,
    *,
    difference: Callable[[Array, Array], Array] = np.subtract,
) -> None:
    found, error = numerical_derivative(function, point, difference=difference)
    _require_shape(name, claimed, found.shape)
    size = float(np.abs(found).max(initial=0.0))
    clear = float(error.max(initial=0.0)) <= 1e-3 * max(size, 1e-3)
    _require(clear, f"{name} can be compared", f"differences do not converge at {point}")
    off = np.abs(claimed - found) - 20.0 * error
    worst = tuple(int(i) for i in np.unravel_index(np.argmax(off), off.shape))
    _require(
        float(off[worst]) <= 1e-13 * size,
        f"{name} is the derivative",
        f"entry {worst} is {claimed[worst]}; differences at {point} give "
        f"{found[worst]} +- {error[worst]}",
    )
