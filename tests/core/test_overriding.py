"""What a user's subclass overrides counts wherever the class is used, or it is refused."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, final

import numba
import numpy as np
import pytest
import sympy

from dynkit import Hyperplane, Map, PoincareMap, basins, periodic_orbit, sweep
from dynkit.analysis import Running
from dynkit.core.differences import numerical_derivative, parameter_difference
from dynkit.core.overriding import Extensible
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.dynamics.hybrid_flow import HybridFlow
from dynkit.engine.executors import NotSendable, pack, perform
from dynkit.systems import (
    BouncingBall,
    CompiledMap,
    HardStop,
    Henon,
    ImpactChain,
    ImpactDuffing,
    ImpactLaw,
    ImpactRod,
    IntegratedFlow,
    Lorenz,
    MatrixOscillator,
    PlayOscillator,
    SingleImpactOscillator,
    SymbolicFlow,
    SymbolicHybridFlow,
    SymbolicMap,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.elements.element import Element, Regime, Watch

# --- methods that follow from an overridden one ---------------------------------------------------


class Halved(Henon):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


class HalvedTwice(Halved):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


class HalvedExactly(Henon):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)

    def jacobian(self, state: Array) -> Array:
        return 0.5 * super().jacobian(state)


class HalvedAgain(HalvedExactly):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


class Mixin:
    def __call__(self, state: Array) -> Array:
        found: Array = 0.5 * super().__call__(state)  # type: ignore[misc]
        return found


class Mixed(Mixin, Henon):
    pass


class Compiled(CompiledMap):
    a: float = 1.4
    b: float = 0.3

    @staticmethod
    @numba.njit
    def next_state(x: float, y: float, a: float, b: float) -> tuple[float, float]:
        return 1.0 - a * x * x + y, b * x

    def jacobian(self, state: Array) -> Array:
        return np.array([[-2.0 * self.a * state[0], 1.0], [self.b, 0.0]])


class CompiledOtherwise(Compiled):
    @staticmethod
    @numba.njit
    def next_state(x: float, y: float, a: float, b: float) -> tuple[float, float]:
        return 0.5 - 0.5 * a * x * x + 0.5 * y, 0.5 * b * x


class CompiledHalved(Compiled):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


class Plain(Map):
    a: float = 1.4

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        x, y = state
        return np.array([1.0 - self.a * x * x + y, 0.3 * x])

    def jacobian(self, state: Array) -> Array:
        return np.array([[-2.0 * self.a * state[0], 1.0], [0.3, 0.0]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        return np.array([-(state[0] ** 2), 0.0])

    def iterate_into(self, states: Array) -> None:
        for i in range(1, len(states)):
            states[i] = Plain.__call__(self, states[i - 1])


class PlainHalved(Plain):
    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


class PlainOfFactors(Plain):
    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        exact = np.array([[-self.a * state[0], 0.5], [0.15, 0.0]])
        return exact[None], np.array([1e-16])

    def __call__(self, state: Array) -> Array:
        return 0.5 * super().__call__(state)


HALVED = [
    Halved(),
    HalvedExactly(),
    Mixed(),
    CompiledOtherwise(),
    CompiledHalved(),
    PlainHalved(),
    PlainOfFactors(),
]
QUARTERED = [HalvedTwice(), HalvedAgain()]
MAPS = [*((own, 0.5) for own in HALVED), *((own, 0.25) for own in QUARTERED)]
NAMED = [f"{type(own).__name__}" for own, _ in MAPS]


@pytest.mark.parametrize(("system", "factor"), MAPS, ids=NAMED)
class TestOverriddenCalls:
    STATE = np.array([0.3, 0.2])

    def expected(self, system: Any, state: Array, factor: float) -> tuple[Array, Array]:
        """The next state, and the exact derivative."""
        x, y = state
        jacobian = np.array([[-2.8 * x, 1.0], [0.3, 0.0]])
        return factor * np.array([1.0 - 1.4 * x * x + y, 0.3 * x]), factor * jacobian

    def test_iterates_are_those_of_the_call(self, system: Any, factor: float) -> None:
        states = system.iterate(self.STATE, 5)
        for here, there in pairwise(states):
            assert there == pytest.approx(self.expected(system, here, factor)[0], rel=1e-14)

    def test_attractors_are_those_of_the_call(self, system: Any, factor: float) -> None:
        states = system.attractor(start=self.STATE, transient=3, keep=5).states
        assert states.tolist() == system.iterate(self.STATE, 7)[3:].tolist()

    def test_derivatives_are_those_of_the_call(self, system: Any, factor: float) -> None:
        _, exact = self.expected(system, self.STATE, factor)
        factors, _ = system.jacobian_factors(self.STATE)
        assert system.jacobian(self.STATE) == pytest.approx(exact, abs=1e-10)
        assert factors[0] == pytest.approx(exact, abs=1e-10)

    def test_exponents_are_those_of_the_call(self, system: Any, factor: float) -> None:
        """Their sum is the mean logarithm of the determinant, which is constant."""
        logs = system.stretching(self.STATE, 20).logs
        assert logs.sum(axis=1) == pytest.approx(math.log(0.3 * factor**2), abs=1e-8)

    def test_growth_is_that_of_the_call(self, system: Any, factor: float) -> None:
        direction = np.array([2.0, 3.0]) ** 0.5 / 5.0**0.5
        _, exact = self.expected(system, self.STATE, factor)
        grown = math.log(float(np.linalg.norm(exact @ direction)))
        assert system._growth(self.STATE, 1)[0] == pytest.approx(grown, abs=1e-9)

    def test_parameters_change_the_call(self, system: Any, factor: float) -> None:
        exact = factor * np.array([-(self.STATE[0] ** 2), 0.0])
        assert system.parameter_derivative(self.STATE, "a") == pytest.approx(exact, abs=1e-9)

    def test_multipliers_are_those_of_the_call(self, system: Any, factor: float) -> None:
        orbit = periodic_orbit(system, [0.4, 0.05])
        _, exact = self.expected(system, orbit.states[0], factor)
        found = sorted(orbit.multipliers.real)
        assert found == pytest.approx(sorted(np.linalg.eigvals(exact).real), abs=1e-8)


def test_an_exact_jacobian_beside_its_own_call_is_kept() -> None:
    assert HalvedExactly().jacobian(np.array([0.3, 0.2])).tolist() == [[-0.42, 0.5], [0.15, 0.0]]


def test_a_subclass_without_its_own_call_keeps_compiled_code() -> None:
    class Same(Henon):
        def difference(self, a: Array, b: Array) -> Array:
            return super().difference(a, b)

    assert Same.jacobian is Henon.jacobian
    assert Same.stretching is Henon.stretching
    assert Same.iterate_into is Henon.iterate_into


def test_a_linear_map_must_define_the_jacobian_that_its_call_uses() -> None:
    class Linear(Map):
        @property
        def dimension(self) -> int:
            return 1

        def jacobian(self, state: Array) -> Array:
            return np.array([[0.5]])

        def __call__(self, state: Array) -> Array:
            return np.asarray(self.jacobian(state) @ state)

    with pytest.raises(TypeError, match="Bent must define jacobian, too, as it overrides __call__"):

        class Bent(Linear):
            def __call__(self, state: Array) -> Array:
                return super().__call__(state) - state**3


def test_a_call_that_is_replaced_in_its_class_renews_what_follows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Own(Henon):
        pass

    class Derived(Own):
        pass

    here, exact = np.array([0.3, 0.2]), Own().jacobian(np.array([0.3, 0.2]))
    with monkeypatch.context() as patch:
        patch.setattr(Own, "__call__", lambda self, state: 0.5 * Henon.__call__(self, state))
        for kind in (Own, Derived):
            assert kind().jacobian(here) == pytest.approx(0.5 * exact, abs=1e-10)
            assert kind().iterate(here, 3)[-1].tolist() == Halved().iterate(here, 3)[-1].tolist()
        patch.setattr(Own, "jacobian", lambda self, state: 0.5 * Henon.jacobian(self, state))
        assert Derived().jacobian(here).tolist() == (0.5 * exact).tolist()
    assert Own.jacobian is Derived.jacobian is Henon.jacobian
    assert Own.stretching is Henon.stretching


def test_a_velocity_that_is_replaced_in_its_class_renews_its_derivative() -> None:
    class Own(Pendulum):
        pass

    Own.velocity = lambda self, state: 2.0 * Pendulum.velocity(self, state)  # type: ignore[method-assign]
    here = np.array([1.0, 0.2])
    found = Own().velocity_jacobian(here)
    assert found == pytest.approx(2.0 * Pendulum().velocity_jacobian(here), abs=1e-9)


@dataclass(frozen=True, kw_only=True)
class Pendulum(IntegratedFlow):
    damping: float = 0.1

    dimension = 2

    def velocity(self, state: Array) -> Array:
        return np.array([state[1], -np.sin(state[0]) - self.damping * state[1]])

    def velocity_jacobian(self, state: Array) -> Array:
        return np.array([[0.0, 1.0], [-np.cos(state[0]), -self.damping]])

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        return np.array([0.0, -state[1]])


class Stiffened(Pendulum):
    def velocity(self, state: Array) -> Array:
        pull: Array = np.array([0.0, state[0] ** 3 + self.damping * state[0]])
        return np.asarray(super().velocity(state) - pull)


@dataclass(frozen=True)
class Doubled(SymbolicFlow):
    damping: float = 0.1

    def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        return rate, -sympy.sin(angle) - self.damping * rate


class DoubledStiffened(Doubled):
    def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        first, second = super().velocity(angle, rate)
        return first, second - angle**3 - self.damping * angle


class OfMixin:
    damping: Any

    def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        pull = sympy.sin(angle) + angle**3 + self.damping * angle
        return rate, -pull - self.damping * rate


class MixedFlow(OfMixin, Doubled):
    pass


@pytest.mark.parametrize("flow", [Stiffened(), DoubledStiffened(), MixedFlow()])
class TestOverriddenVelocities:
    STATE = np.array([1.0, 0.2])

    def test_motions_are_those_of_the_velocity(self, flow: Any) -> None:
        expected = Stiffened().advance(self.STATE, 2.0)
        assert flow.advance(self.STATE, 2.0) == pytest.approx(expected, abs=1e-9)
        assert flow.velocity(self.STATE) == pytest.approx(Stiffened().velocity(self.STATE))

    def test_derivatives_are_those_of_the_velocity(self, flow: Any) -> None:
        def advanced(state: Array) -> Array:
            return np.asarray(flow.advance(state, 2.0))

        expected, _ = numerical_derivative(advanced, self.STATE, accuracy=1e-12)
        assert flow.derivative(self.STATE, 2.0) == pytest.approx(expected, abs=1e-7)

    def test_parameters_change_the_velocity(self, flow: Any) -> None:
        def advanced(damping: float) -> Array:
            return np.asarray(flow.replace(damping=damping).advance(self.STATE, 2.0))

        expected = parameter_difference(advanced, 0.1, accuracy=1e-12)
        found = flow.parameter_derivative(self.STATE, 2.0, "damping")
        assert found == pytest.approx(expected, abs=1e-7)

    def test_returns_are_those_of_the_velocity(self, flow: Any) -> None:
        returns, expected = (
            PoincareMap(own, Hyperplane(np.array([0.0, 1.0]), direction=-1), time_limit=100.0)
            for own in (flow, Stiffened())
        )
        assert returns(np.ones(1)) == pytest.approx(expected(np.ones(1)), abs=1e-9)
        slope, _ = numerical_derivative(returns.image, np.array([1.0]), accuracy=1e-12)
        assert returns.jacobian(np.ones(1)) == pytest.approx(slope, abs=1e-7)


def test_a_guard_of_a_subclass_has_its_own_gradient() -> None:
    class Ball(HybridFlow, Pendulum):
        def guard(self, state: Array) -> float:
            return float(state[0])

        def guard_gradient(self, state: Array) -> Array:
            return np.array([1.0, 0.0])

        def reset(self, state: Array) -> Array:
            return np.array([state[0], -state[1]])

    class Slope(Ball):
        def guard(self, state: Array) -> float:
            return float(state[0] + 0.5 * state[1])

    assert Slope().guard_gradient(np.array([0.1, 0.2])) == pytest.approx([1.0, 0.5], abs=1e-9)


def test_an_integral_of_a_subclass_has_its_own_gradient() -> None:
    class Swing(Pendulum):
        integrals = ("energy",)

        def energy(self, state: Array) -> float:
            return float(0.5 * state[1] ** 2 - np.cos(state[0]))

        def integral_gradient(self, name: str, state: Array) -> Array:
            return np.array([np.sin(state[0]), state[1]])

    class Twice(Swing):
        def energy(self, state: Array) -> float:
            return 2.0 * super().energy(state)

    here = np.array([0.1, 0.2])
    found = Twice().integral_gradient("energy", here)
    assert found == pytest.approx(2.0 * Swing().integral_gradient("energy", here), abs=1e-9)


def test_a_guard_of_a_mixin_takes_states() -> None:
    class Guard:
        def guard(self, angle: Any, rate: Any) -> Any:
            return 1 - angle

        def reset(self, angle: Any, rate: Any) -> tuple[Any, ...]:
            return -angle, rate

    class Reset(Guard, SymbolicHybridFlow):
        def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
            return rate, -angle

    own: Any = Reset()
    assert own.guard([0.25, 0.0]) == 0.75
    assert own.reset([0.25, 1.0]).tolist() == [-0.25, 1.0]
    assert own.armed([0.25, 1.0]) == 1.0


# --- fields that energies use ---------------------------------------------------------------------


class Rotor(ImpactChain):
    """Its frequency is the rate of a rotation that stiffens the first spring."""

    def potential(self, x: Any) -> Any:
        return super().potential(x) + self.frequency**2 * x[0] ** 2


class Loaded(SingleImpactOscillator):
    def potential(self, x: Any) -> Any:
        return (1 + self.force) * x[0] ** 2 / 2


class Offset(PlayOscillator):
    @property
    def strength(self) -> float:
        return 2.0 * self.force

    def dissipation(self, v: Any) -> Any:
        return self.strength * v[0] ** 2 / 2


class Heavy(BouncingBall):
    def kinetic(self, v: Any) -> Any:
        return self.gravity * v[0] ** 2 / 2


class Rebound(Rotor):
    """A subclass of a subclass."""

    def dissipation(self, v: Any) -> Any:
        return super().dissipation(v) + self.restitution * v[0] ** 2 / 2


USED = [
    (Rotor(masses=2, frequency=0.5), "frequency", 2.0, "stiffness", 2.0 + 8.0),
    (Loaded(frequency=0.5, force=1.0), "force", 2.0, "stiffness", 3.0),
    (Offset(frequency=0.5, force=1.0), "force", 2.0, "damping_matrix", 4.0),
    (Heavy(frequency=0.5, gravity=1.0), "gravity", 2.0, "mass", 2.0),
    (Rebound(masses=2, frequency=0.5), "frequency", 2.0, "stiffness", 2.0 + 8.0),
    (Rebound(masses=2, frequency=0.5), "restitution", 0.25, "damping_matrix", 0.2 + 0.25),
]


@pytest.mark.parametrize(("system", "name", "value", "matrix", "expected"), USED)
def test_fields_that_an_energy_uses_change_its_matrices(
    system: Any, name: str, value: float, matrix: str, expected: float
) -> None:
    before = getattr(system, matrix)[0, 0]
    changed = system.replace(**{name: value})
    made = type(system)(**{k: getattr(changed, k) for k in changed._arguments})
    assert getattr(changed, matrix)[0, 0] == pytest.approx(expected)
    assert getattr(made, matrix)[0, 0] == pytest.approx(expected)
    assert getattr(system, matrix)[0, 0] == before != pytest.approx(expected)


def test_a_used_field_counts_in_derivatives_sweeps_and_branches() -> None:
    rotor = Rotor(masses=2, frequency=0.9)
    state = rotor.attractor().states[-1]
    found = rotor.parameter_derivative(state, "frequency")
    expected = parameter_difference(
        lambda frequency: rotor.replace(frequency=frequency)(state), 0.9, accuracy=1e-14
    )
    assert found == pytest.approx(expected, rel=1e-6)
    swept = sweep(rotor, "frequency", [0.9, 1.1], follow=False, progress=False)
    alone = Rotor(masses=2, frequency=1.1).attractor()
    assert (
        swept.observable("relative_velocity")[1].tolist()
        == alone.observable("relative_velocity").tolist()
    )


def test_fields_that_no_energy_uses_share_one_derivation() -> None:
    chain = ImpactChain(masses=2, frequency=0.9)
    assert chain.replace(amplitude=0.2)._derivation is chain._derivation
    assert ImpactChain(masses=2, frequency=1.7)._derivation is chain._derivation
    rotor = Rotor(masses=2, frequency=0.9)
    assert rotor.replace(amplitude=0.2)._derivation is rotor._derivation


def test_a_coordinate_of_elements_may_use_any_field() -> None:
    class Curved(ImpactChain):
        def height(self, x: Any) -> Any:
            return x[-1] + self.amplitude * x[0] ** 2

    own = [HardStop("height", amplitude=0.1, name="table")]
    chain = Curved(masses=2, frequency=0.9, elements=own)
    assert "0.1" in str(chain.identity["height"])
    assert "0.3" in str(chain.replace(**{"table.amplitude": 0.3}).identity["height"])


# --- starts ---------------------------------------------------------------------------------------


class Thrown(ImpactChain):
    @property
    def default_start(self) -> Any:
        return self.state([0.5, 3.0])


def test_a_default_start_of_its_own_is_that_of_all_motions() -> None:
    chain = Thrown(masses=2, frequency=0.9)
    expected = ImpactChain(masses=2, frequency=0.9).simulate(
        impacts=3, start=ImpactChain(masses=2, frequency=0.9).state([0.5, 3.0])
    )
    wanted = expected.relative_velocity.tolist()
    assert chain.simulate(impacts=3).relative_velocity.tolist() == wanted
    kept = chain.attractor(transient=0, keep=3)
    assert kept.observable("relative_velocity").tolist() == wanted


def _chain(**members: Any) -> Any:
    """A chain of a class of one name, whatever its members are."""
    kind: Any = _of(ImpactChain, **members)()
    return kind(masses=2, frequency=0.9)


def _thrown(speed: float) -> Any:
    return lambda self: self.state([0.5, 3.0], [0.0, speed])


@pytest.mark.parametrize(
    "members",
    [
        lambda speed: {"default_start": property(_thrown(speed))},
        lambda speed: {"state_from": lambda self, numbers: self.state(numbers[:2] * speed)},
        lambda speed: {"start_size": property(lambda _: 5 + int(speed))},
    ],
)
def test_a_store_is_not_continued_by_a_class_that_starts_otherwise(
    members: Callable[[float], dict[str, Any]], tmp_path: Path
) -> None:
    store, given = tmp_path / "own.h5", dict[str, Any](transient=3, keep=3, progress=False)
    for speed in (1.0, 1.0):
        sweep(_chain(**members(speed)), "frequency", [0.9], store=store, **given)
    with pytest.raises(ValueError, match="was made with code"):
        sweep(_chain(**members(2.0)), "frequency", [0.9], store=store, **given)
    with pytest.raises(ValueError, match="was made with code"):
        sweep(_chain(), "frequency", [0.9], store=store, **given)


def test_a_store_is_continued_by_energies_of_the_same_matrices(tmp_path: Path) -> None:
    def one(self: Any, x: Any) -> Any:
        return ImpactChain.potential(self, x) + x[0] ** 2

    def other(self: Any, x: Any) -> Any:
        return x[0] ** 2 + ImpactChain.potential(self, x)

    store, given = tmp_path / "own.h5", dict[str, Any](transient=3, keep=3, progress=False)
    made = sweep(_chain(potential=one), "frequency", [0.9], store=store, **given)
    same = sweep(_chain(potential=other), "frequency", [0.9], store=store, **given)
    assert same.cost.counts == made.cost.counts


class Falling(BouncingBall):
    """Starts are given by height and downward velocity."""

    def state_from(self, numbers: Array) -> Any:
        return super().state_from(numbers * [1.0, -1.0, 1.0])


class Downward(BouncingBall):
    """Velocities of states are downward ones."""

    def state(
        self, position: Any = None, velocity: Any = None, phase: float = 0.0, sliders: Any = None
    ) -> Any:
        upward = None if velocity is None else -np.asarray(velocity)
        return super().state(position, upward, phase, sliders)


@pytest.mark.parametrize("kind", [Falling, Downward])
def test_starts_of_its_own_are_those_of_basins(kind: type[BouncingBall]) -> None:
    """P(1,1) and P(1,2) are both stable; from 1000 starts on, many are simulated together."""
    numbers: dict[str, Any] = {"frequency": 3.0, "restitution": 0.8, "amplitude": 0.1}
    run: dict[str, Any] = {"transient": 200, "keep": 10, "progress": False}
    random = np.random.default_rng(0)
    given = random.uniform([0.2, -3.0, 0.0], [3.0, 3.0, 6.0], (1000, 3))
    expected = basins(BouncingBall(**numbers), given, **run)
    found = basins(kind(**numbers), given * [1.0, -1.0, 1.0], **run)
    assert len(set(expected.numbers.tolist())) > 1
    assert found.numbers.tolist() == expected.numbers.tolist()


# --- laws -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Constant(ImpactLaw):
    number: float = 0.5

    def expression(self, velocity: Any) -> Any:
        return self.number + 0 * velocity

    @property
    def tail(self) -> tuple[float, float, float, float, float]:
        return self.number, 0.0, 0.0, 0.0, 0.0


class Weaker(Constant):
    def expression(self, velocity: Any) -> Any:
        return 0.5 * self.number + 0 * velocity


def test_the_tail_of_a_law_belongs_to_its_expression() -> None:
    assert Weaker().tail == (0.25, 0.0, 0.0, 0.0, 0.0)
    assert Constant().tail == (0.5, 0.0, 0.0, 0.0, 0.0)


# --- refusals -------------------------------------------------------------------------------------


def _of(*bases: type, **members: Any) -> Callable[[], type]:
    def define() -> type:
        return type(bases[0])("Own", bases, members)

    return define


def _method(self: Any, *_: Any) -> Any:
    return None


REFUSED = [
    (_of(ViscoelasticSpheres, expression=_method), "subclass of ViscoelasticSpheres, which is"),
    (_of(HardStop, regimes=()), "subclass of HardStop, which is final"),
    (_of(ImpactDuffing, potential=_method), "subclass of ImpactDuffing, which is final"),
    (_of(PoincareMap), "subclass of PoincareMap, which is final"),
    (_of(Hyperplane), "subclass of Hyperplane, which is final"),
    (_of(Constant, at=_method), "must not override at of ImpactLaw"),
    (_of(Constant, slope=_method), "must not override slope of ImpactLaw"),
    (_of(Constant, numbers=property(_method)), "must not override numbers of ImpactLaw"),
    (_of(Element, row=_method), "must not override row of Element"),
    (_of(Element, curved=property(_method)), "must not override curved of Element"),
    (_of(Henon, iterate=_method), "must not override iterate of SmoothMap"),
    (_of(Henon, image=_method), "must not override image of SmoothMap"),
    (_of(Lorenz, advance=_method), "must not override advance of SymbolicFlow"),
    (_of(Lorenz, derivative=_method), "must not override derivative of SymbolicFlow"),
    (_of(Pendulum, advance=_method), "must not override advance of IntegratedFlow"),
    (_of(ImpactChain, __call__=_method), "must not override __call__ of ImpactMap"),
    (_of(ImpactChain, jacobian=_method), "must not override jacobian of ImpactMap"),
    (_of(ImpactChain, difference=_method), "must not override difference of ImpactMap"),
    (_of(ImpactChain, stiffness=property(_method)), "override stiffness of LagrangianStructure"),
    (_of(MatrixOscillator, modes=property(_method)), "override modes of LagrangianStructure"),
    (_of(ImpactChain, restitution=0.5), "must annotate restitution, a field of its base class"),
    (_of(Henon, b=0.2), "must annotate b, a field of its base class"),
    (_of(HybridFlow, value_of=_method), "must not override value_of of Family"),
    (_of(ImpactChain, simulate=_method), "must not override simulate of ImpactOscillator"),
    (_of(BouncingBall, attractor=_method), "must not override attractor of ImpactOscillator"),
    (_of(PlayOscillator, find_orbits=_method), "must not override find_orbits of ImpactOscillator"),
    (_of(ImpactChain, observables=property(_method)), "override observables of ImpactOscillator"),
    (_of(ImpactChain, parameter_derivative=_method), "parameter_derivative of ImpactOscillator"),
    (_of(ImpactChain, call_errors=_method), "must not override call_errors of ImpactMap"),
    (_of(ImpactChain, accuracy=property(_method)), "must not override accuracy of ImpactMap"),
    (
        _of(MatrixOscillator, engine=property(_method)),
        "must not override engine of Driven",
    ),
    (_of(ImpactChain, dimension=property(_method)), "override dimension of DrivenStructure"),
    (_of(ImpactChain, natural_frequencies=property(_method)), "override natural_frequencies of"),
    (_of(ImpactRod, kinetic=_method), "must not override kinetic of ImpactRod"),
    (_of(SingleImpactOscillator, grazing_force=property(_method)), "override grazing_force of"),
    (_of(Henon, dimension=property(_method)), "must not override dimension of CodedFamily"),
    (_of(Map, stream=_method), "must not override stream of Map"),
    (_of(Map, orbit_factors=_method), "must not override orbit_factors of Map"),
    (_of(Pendulum, integral=_method), "must not override integral of Flow"),
    (_of(Running, add=_method), "must not override add of Running"),
]


@pytest.mark.parametrize(("define", "message"), REFUSED, ids=[text for _, text in REFUSED])
def test_overrides_without_effect_are_refused(define: Callable[[], type], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        define()


def test_a_refusal_says_what_may_be_overridden() -> None:
    with pytest.raises(TypeError, match=r"a subclass may override default_start, .* potential, "):
        _of(ImpactChain, simulate=_method)()


def test_a_final_method_that_is_final_again_is_refused() -> None:
    with pytest.raises(TypeError, match="must not override iterate of SmoothMap"):
        _of(Henon, iterate=final(lambda self: None))()


def test_an_override_by_a_mixin_is_refused() -> None:
    class Jumps:
        iterate = _method

    with pytest.raises(TypeError, match="Own must not override iterate of SmoothMap"):
        type("Own", (Jumps, Henon), {})


def test_members_of_final_classes_are_no_final_members() -> None:
    @final
    class Number:
        pass

    class Base(Extensible):
        number = Number()

    class Own(Base):
        number = Number()

    assert Own.number is not Base.number


def test_a_computed_attribute_of_a_symbolic_map_is_refused() -> None:
    class Halving(SymbolicMap):
        rate: float = 3.2
        half: float = field(init=False, default=0.0)

        def __post_init__(self) -> None:
            super().__post_init__()
            object.__setattr__(self, "half", 0.5 * self.rate)

        def next_state(self, x: Any) -> tuple[Any, ...]:
            return (2 * self.half * x * (1 - x),)

    with pytest.raises(TypeError, match=r"Halving\.half must be an argument or a property"):
        Halving()(np.array([0.3]))


# --- classes that are defined again ---------------------------------------------------------------


def first() -> Any:
    class Own(SymbolicMap):
        rate: float = 3.2

        def next_state(self, x: Any) -> tuple[Any, ...]:
            return (self.rate * x * (1 - x),)

    return Own


def second() -> Any:
    class Own(SymbolicMap):
        rate: float = 3.2

        def next_state(self, x: Any) -> tuple[Any, ...]:
            """Return another map."""
            return (self.rate * sympy.sin(x) / 4,)

    return Own


def first_plain() -> Any:
    class Own(Map):
        rate: float = 3.2
        dimension = 1

        def __call__(self, state: Array) -> Array:
            return self.rate * state * (1.0 - state)

    return Own


def second_plain() -> Any:
    class Own(Map):
        rate: float = 3.2
        dimension = 1

        def __call__(self, state: Array) -> Array:
            return self.rate * state * (1.1 - state)

    return Own


def first_compiled() -> Any:
    class Own(CompiledMap):
        rate: float = 3.2

        @staticmethod
        @numba.njit
        def next_state(x: float, rate: float) -> tuple[float]:
            return (rate * x * (1.0 - x),)

    return Own


def second_compiled() -> Any:
    class Own(CompiledMap):
        rate: float = 3.2

        @staticmethod
        @numba.njit
        def next_state(x: float, rate: float) -> tuple[float]:
            return (rate * x * (1.1 - x),)

    return Own


AGAIN = [(first, second), (first_plain, second_plain), (first_compiled, second_compiled)]


@pytest.mark.parametrize(("one", "other"), AGAIN, ids=["symbolic", "plain", "compiled"])
def test_a_class_defined_again_shares_no_code_and_no_store(
    one: Callable[[], Any], other: Callable[[], Any], tmp_path: Path
) -> None:
    kinds = [one(), one(), other()]
    for kind in kinds:
        kind.__qualname__ = "Own"
    states = [kind()(np.array([0.3]))[0] for kind in kinds]
    assert states[0] == states[1] != states[2]
    store, given = tmp_path / "own.h5", dict[str, Any](start=[0.3], progress=False)
    made = sweep(kinds[0](), "rate", [3.2, 3.3], store=store, **given)
    same = sweep(kinds[1](), "rate", [3.2, 3.3], store=store, **given)
    assert same.observable("state[0]").tolist() == made.observable("state[0]").tolist()
    with pytest.raises(ValueError, match="was made with code"):
        sweep(kinds[2](), "rate", [3.2, 3.3], store=store, **given)


def test_workers_that_know_another_definition_refuse_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module, (one, other) = sys.modules[__name__], (first_plain(), second_plain())
    for kind in (one, other):
        kind.__qualname__ = "Own"
    monkeypatch.setattr(module, "Own", one, raising=False)
    start, first_states = pack(np.array([0.3])), one().iterate(np.array([0.3]), 2)
    found, error = perform(pack(partial(SmoothMap.iterate, one(), n=2)), start)
    assert error is None
    assert found.tolist() == first_states.tolist()
    monkeypatch.setattr(module, "Own", other)
    found, error = perform(pack(partial(SmoothMap.iterate, other(), n=2)), start)
    assert error is None
    assert found.tolist() == other().iterate(np.array([0.3]), 2).tolist()
    late = pack(partial(SmoothMap.iterate, other(), n=3))
    monkeypatch.setattr(module, "Own", one)
    _, error = perform(late, start)
    assert isinstance(error, NotSendable)
    assert "the worker knows another definition of Own" in str(error)


def test_a_method_that_is_replaced_in_its_class_counts_in_new_instances() -> None:
    kind = first()
    assert kind()([0.3])[0] == pytest.approx(3.2 * 0.21)
    kind.next_state = second().next_state
    assert kind()([0.3])[0] == pytest.approx(0.8 * math.sin(0.3))


class Springy:
    """Terms of a potential that a class attribute and a helper determine."""

    extra: ClassVar[float] = 1.0

    def more(self, x: Any) -> Any:
        return x


def test_members_of_a_class_that_energies_use_count_when_they_are_replaced() -> None:
    class Own(Springy, ImpactChain):
        def potential(self, x: Any) -> Any:
            return super().potential(x) + self.extra * self.more(x[0]) ** 2

    def stiffness() -> float:
        return float(Own(masses=2, frequency=0.9).stiffness[0, 0])

    assert stiffness() == 4.0
    Own.extra = 2.0
    assert stiffness() == 6.0
    Own.more = lambda self, x: 2 * x  # type: ignore[method-assign]
    assert stiffness() == 18.0


def test_members_of_a_class_that_expressions_use_count_when_they_are_replaced() -> None:
    class Own(Springy, SymbolicMap):
        rate: float = 3.2

        def next_state(self, x: Any) -> tuple[Any, ...]:
            return (self.rate * self.extra * self.more(x),)

    assert Own()(np.array([0.3])) == pytest.approx([0.96])
    Own.extra = 2.0
    assert Own()(np.array([0.3])) == pytest.approx([1.92])
    Own.more = lambda self, x: x**2  # type: ignore[method-assign]
    assert Own()(np.array([0.3])) == pytest.approx([0.576])


def test_regimes_of_elements_are_part_of_the_identity() -> None:
    def own(stiffness: float, velocity: float = 0.0) -> ImpactChain:
        @dataclass(frozen=True)
        class Spring(Element):
            @property
            def regimes(self) -> tuple[Regime, ...]:
                return (Regime((Watch(to=0, level=1.0),), stiffness=stiffness),)

            @property
            def drift(self) -> float:
                return velocity

        elements = [HardStop(1, amplitude=0.1), Spring(0)]
        return ImpactChain(masses=2, frequency=0.9, elements=elements)

    assert own(1.0).identity["elements"] == own(2.0).identity["elements"]
    assert own(1.0).identity == own(1.0).identity != own(2.0).identity
    assert own(1.0).identity != own(1.0, 0.5).identity
