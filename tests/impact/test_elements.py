"""Elements of one's own: a spring that is touched only, in the engine of the hard stops."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import ImpactChain
from dynkit.systems.impact.elements import SWITCH, Element, EventKind, Regime, Watch
from dynkit.systems.impact.motion import sample_run
from dynkit.systems.impact.record import ImpactRecord
from dynkit.systems.impact.trajectory import Ending, Trajectory

DIGITS = 40
SPRING = 7.0
PLACE = 0.05


@dataclass(frozen=True)
class Buffer(Element):
    """A spring that pushes a coordinate while it is beyond a place."""

    coordinate: Any
    offset: float
    sign: int
    phasor: complex
    stiffness: float

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        touched = Watch(SWITCH, to=1, gap=1.0, order=1)
        let_go = Watch(SWITCH, to=0, gap=-self.stiffness, order=1)
        return Regime((touched,)), Regime((let_go,), stiffness=self.stiffness)


@dataclass(frozen=True)
class DampedBuffer(Element):
    """The same with a dashpot: it never pulls, and is left before its gap has closed."""

    coordinate: Any
    offset: float
    sign: int
    phasor: complex
    stiffness: float
    damping: float

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        k, c = self.stiffness, self.damping
        touched = Watch(SWITCH, to=1, gap=1.0)
        lifted = Watch(SWITCH, to=2, gap=-k, rate=-c, order=1)
        pressed_again = Watch(SWITCH, to=1, gap=k, rate=c, order=1)
        let_go = Watch(SWITCH, to=0, gap=-1.0, order=1)
        pressing = Regime((lifted,), stiffness=k, damping=c)
        return Regime((touched,)), pressing, Regime((pressed_again, let_go))


@dataclass(frozen=True, kw_only=True)
class BufferedChain(ImpactChain):
    """A chain with a spring that is touched, by its first mass or between two, and moves."""

    buffer: float = SPRING
    dashpot: float = 0.0
    motion: complex = 0.1
    between: Any = None

    @property
    def _elements(self) -> tuple[Element, ...]:
        place = self.between or 0, PLACE, 1, self.motion
        if self.dashpot:
            return *self._stops, DampedBuffer(*place, self.buffer, self.dashpot)
        return *self._stops, Buffer(*place, self.buffer)


class Reference:
    """The same motion in many digits: matrix exponentials of (x, v, sine, cosine, one)."""

    def __init__(self, chain: BufferedChain) -> None:
        self.chain, n = chain, chain.degrees_of_freedom
        w, a, r = (mp.mpf(v) for v in (chain.frequency, chain.amplitude, chain.offset))
        m, b = mp.mpf(chain.motion.real), mp.mpf(chain.motion.imag)
        inverse = mp.matrix(chain.mass.tolist()) ** -1
        row = mp.zeros(n, 1)
        if chain.between:
            row[chain.between[0]], row[chain.between[1]] = -1, 1
        else:
            row[0] = 1
        free = []
        for stiffness, drag in ((0, 0), (mp.mpf(chain.buffer), mp.mpf(chain.dashpot))):
            k, c = (mp.matrix(part.tolist()) for part in (chain.stiffness, chain.damping_matrix))
            k, c = (part + number * row * row.T for part, number in ((k, stiffness), (c, drag)))
            flow = mp.zeros(2 * n + 3)
            push = inverse * row
            for i in range(n):
                flow[i, n + i] = 1
                for j in range(n):
                    flow[n + i, j] = -(inverse * k)[i, j]
                    flow[n + i, n + j] = -(inverse * c)[i, j]
                flow[n + i, 2 * n] = push[i] * (stiffness * m - drag * w * b)
                flow[n + i, 2 * n + 1] = push[i] * (stiffness * b + drag * w * m)
                flow[n + i, 2 * n + 2] = push[i] * stiffness * mp.mpf(PLACE)
            flow[2 * n, 2 * n + 1], flow[2 * n + 1, 2 * n] = w, -w
            free.append(flow)
        held = [flow.copy() for flow in free]  # the mass matrix is diagonal
        for flow in held:
            for j in range(2 * n + 3):
                flow[n - 1, j] = flow[2 * n - 1, j] = 0
            flow[n - 1, 2 * n + 1], flow[2 * n - 1, 2 * n] = a * w, -a * w * w
        self.flows, self.inverse = (free, held), inverse
        self.forces = [
            (after[2 * n - 1, :] - before[2 * n - 1, :])
            for before, after in zip(free, held, strict=True)
        ]
        self.table, gap = mp.zeros(1, 2 * n + 3), mp.zeros(1, 2 * n + 3)
        self.table[n - 1], self.table[2 * n], self.table[2 * n + 2] = 1, -a, -r
        for i in range(n):
            gap[i] = row[i]
        gap[2 * n], gap[2 * n + 1], gap[2 * n + 2] = -m, -b, -mp.mpf(PLACE)
        force = -mp.mpf(chain.buffer) * gap - mp.mpf(chain.dashpot) * gap * free[0]
        # of each regime of the spring: what is positive in it, and what follows
        self.watched = [[(gap, 1)], [(force, 2 if chain.dashpot else 0)], [(-force, 1), (-gap, 0)]]

    def impacts(self, start: Array, count: int, step: float = 0.02) -> list[tuple[Any, Any]]:
        """Times and states of so many impacts; after one without rebound there may be contact."""
        n, r = self.chain.degrees_of_freedom, mp.mpf(self.chain.restitution)
        z, time, regime, held = mp.matrix([*start.tolist(), 0, 1, 1]), mp.mpf(0), 0, 0
        while left := [after for row, after in self.watched[regime] if (row * z)[0] < 0]:
            regime = left[0]
        found: list[tuple[Any, Any]] = []
        steps = [[mp.expm(flow * mp.mpf(step)) for flow in flows] for flows in self.flows]
        self.switches_in_contact = 0
        while len(found) < count:
            pressed = regime == 1
            flow = self.flows[held][pressed]
            there = steps[held][pressed] * z
            leaves = self.forces[pressed] if held else self.table
            events = [(leaves, -1), *self.watched[regime]]
            hit = [(row, after) for row, after in events if (row * there)[0] < 0]
            if not hit:
                z, time = there, time + mp.mpf(step)
                continue
            terms = series(flow, z, step)
            wait, after = min((self._root(row, terms, mp.mpf(step)), k) for row, k in hit)
            z, time = sum((term * wait**k for k, term in enumerate(terms)), 0 * z), time + wait
            if after >= 0:
                regime = after
                self.switches_in_contact += held
            elif held:
                held = 0
            else:
                rate = (self.table * flow * z)[0]
                for i in range(n):
                    z[n + i] -= (1 + r) * rate * self.inverse[i, n - 1] / self.inverse[n - 1, n - 1]
                found.append((time, z.copy()))
                for row, after in self.watched[regime]:  # forces of dashpots have jumped
                    if (row * z)[0] < 0:
                        regime = after
                        break
                held = int(r == 0 and (self.forces[regime == 1] * z)[0] > 0)
            # past the event by nothing that counts: the next step begins on the other side
            z += mp.mpf(10) ** -(DIGITS - 8) * (self.flows[held][regime == 1] * z)
        return found

    @staticmethod
    def _root(row: Any, terms: Any, step: Any) -> Any:
        polynomial = [(row * term)[0] for term in reversed(terms)]
        low, high, value = mp.mpf(0), step, polynomial[-1]
        for _ in range(12):
            middle = (low + high) / 2
            same = mp.polyval(polynomial, middle) * value > 0
            low, high = (middle, high) if same else (low, middle)
        t = (low + high) / 2
        for _ in range(6):
            value, slope = mp.polyval(polynomial, t, derivative=True)
            t -= value / slope
        return t


def series(flow: Any, z: Any, step: float) -> list[Any]:
    """Taylor's series of the motion, as long as it counts within a step."""
    terms = [z]
    while mp.norm(terms[-1], mp.inf) * mp.mpf(step) ** (len(terms) - 1) > mp.mpf(10) ** -DIGITS:
        terms.append(flow * terms[-1] / len(terms))
    return terms


def motion(chain: BufferedChain, count: int, place: Any = None) -> tuple[Trajectory, Array]:
    start = chain.state(place)
    run = chain._run(start, count, store=True)
    return run, np.concatenate([start.position, start.velocity])


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize(("masses", "amplitude"), [(1, 0.5), (2, 0.1), (3, 0.1)])
def test_an_element_of_ones_own_gives_the_motion_of_many_digits(
    masses: int, amplitude: float, dashpot: float
) -> None:
    chain = BufferedChain(
        masses=masses, frequency=0.9, restitution=0.6, amplitude=amplitude, dashpot=dashpot
    )
    run, start = motion(chain, 12)
    assert run.impacts == 12
    assert run.guards[run.log.guard, 0].any()  # some impacts are while the spring pushes
    switched = run.segments.kind == EventKind.SWITCH
    assert (run.segments.element[switched] == 1).sum() >= 4
    assert not len(run.contacts)
    with mp.workdps(DIGITS):
        expected = Reference(chain).impacts(start, 12)
    compare(chain, run, expected)


def compare(chain: BufferedChain, run: Trajectory, expected: list[tuple[Any, Any]]) -> None:
    """Times and states of the impacts, with what they should be."""
    size = chain.dimension
    with mp.workdps(DIGITS):
        late = [
            abs(float(mp.mpf(t) - e)) for t, (e, _) in zip(run.time.tolist(), expected, strict=True)
        ]
    states = np.array([[float(number) for number in z] for _, z in expected])[:, :size]
    assert max(late) < 1e-12
    record = ImpactRecord(chain, run)
    assert abs(np.concatenate([record.position, record.velocity], axis=1) - states).max() < 1e-12
    sampled = sample_run(chain, run, run.time)
    assert abs(np.concatenate(sampled, axis=1) - states).max() < 1e-12


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
def test_a_motion_may_begin_where_an_element_acts(dashpot: float) -> None:
    chain = BufferedChain(masses=2, frequency=0.9, restitution=0.6, dashpot=dashpot)
    run, start = motion(chain, 8, [-0.5, 1.0])
    with mp.workdps(DIGITS):
        expected = Reference(chain).impacts(start, 8)
    compare(chain, run, expected)
    assert run.segments.kind[1] == EventKind.SWITCH
    assert run.segments.begin[1] == 0.0
    events = ImpactRecord(chain, run).events
    assert events.time[0] > 0.0
    assert len(events) == len(run.segments.kind) - 2


def test_a_motion_goes_on_from_where_an_element_acts() -> None:
    chain = BufferedChain(masses=2, frequency=0.9, restitution=0.6, dashpot=0.6)
    whole = chain.simulate(impacts=12)
    pressed = [k for k in range(1, 11) if whole._run.guards[whole._run.log.guard[k - 1], 0]]
    assert pressed
    for k in pressed:
        first = chain.simulate(impacts=k)
        rest = chain.simulate(impacts=12 - k, start=first.final)
        assert np.abs(rest.states - whole.states[k:]).max() < 1e-12


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize(("masses", "between"), [(2, None), (3, None), (3, (0, 1)), (3, (2, 1))])
def test_an_element_acts_while_a_mass_lies_on_the_table(
    masses: int, between: Any, dashpot: float
) -> None:
    chain = BufferedChain(
        masses=masses,
        frequency=0.55,
        restitution=0.0,
        amplitude=0.3,
        dashpot=dashpot,
        motion=0.2 + 0.15j,
        between=between,
    )
    run, start = motion(chain, 12)
    with mp.workdps(DIGITS):
        reference = Reference(chain)
        expected = reference.impacts(start, 12)
    assert reference.switches_in_contact >= 4
    assert len(run.contacts) >= 5
    compare(chain, run, expected)


def test_a_spring_that_is_not_touched_costs_nothing() -> None:
    chain = BufferedChain(masses=2, frequency=0.9, restitution=0.6, offset=10.0)
    run, _ = motion(chain, 20)
    assert not len(run.switches.time)
    assert len(chain._automaton.modes) == 1


def test_more_guards_and_modes_are_not_compiled_for() -> None:
    from dynkit.systems.impact import kernels

    motion(BufferedChain(masses=2, frequency=0.9, restitution=0.6), 5)
    compiled: Any = kernels.run
    before = len(compiled.signatures)

    @dataclass(frozen=True, kw_only=True)
    class Twice(BufferedChain):
        @property
        def _elements(self) -> tuple[Element, ...]:
            return *self._stops, Buffer(0, PLACE, 1, 0j, 3.0), Buffer(0, 0.02, 1, 0j, 5.0)

    run, _ = motion(Twice(masses=2, frequency=0.9, restitution=0.6), 5)
    assert len(run.regimes) > 2
    assert len(compiled.signatures) == before


def test_kernels_and_elements_number_events_alike() -> None:
    from dynkit.systems.impact import elements, kernels

    assert (kernels.IMPACT, kernels.SWITCH) == (elements.IMPACT, elements.SWITCH)


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize(("restitution", "frequency"), [(0.6, 0.9), (0.0, 0.55)])
def test_derivatives_through_an_element_are_differences(
    restitution: float, frequency: float, dashpot: float
) -> None:
    chain = BufferedChain(
        masses=2,
        frequency=frequency,
        restitution=restitution,
        amplitude=0.2,
        dashpot=dashpot,
        motion=0.1 + 0.05j,
    )
    record = chain.simulate(impacts=40)
    run = record._run
    switched = np.unique(run.switches.before[run.guards[run.switches.guard, 3] == EventKind.SWITCH])
    checked = 0
    for state in record.states[switched[switched > 0][:8] - 1]:
        exact, size = chain.jacobian(state), 1e-6
        # without rebound a bounce that the step makes is an impact more
        directions = [k for k in range(chain.dimension) if restitution or k != 2]
        for k in directions:
            step = size * np.eye(chain.dimension)[k]
            change = chain.difference(chain(state + step), chain(state - step)) / (2.0 * size)
            assert abs(exact[:, k] - change).max() < 1e-6 * max(1.0, abs(exact).max())
        checked += 1
    assert checked >= 3
    if restitution:
        logs = chain.stretching(record.states[0], 30).logs.sum(axis=0)
        product = np.eye(chain.dimension)
        for state in record.states[:30]:
            product = chain.jacobian(state) @ product
        assert logs.sum() == pytest.approx(np.linalg.slogdet(product)[1], abs=1e-6)
        assert np.isfinite(logs[0])


def test_moments_through_an_element_are_those_of_samples() -> None:
    chain = BufferedChain(masses=2, frequency=0.9, restitution=0.6, dashpot=0.6)
    record = chain.simulate(impacts=60)
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    x, _ = record.sample(times)
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    square = np.trapezoid(x[:, :, None] * x[:, None], times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6
    assert abs(moments.products.sum(axis=0) / times[-1] - square).max() < 1e-6


@pytest.mark.parametrize("offset", [-20.0, 20.0])
def test_a_motion_without_impacts_comes_to_an_end(
    offset: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynkit.systems.impact.runs.MOST_SWITCHES", 100)
    forces = [0.5, 0.0]
    weight = [-20.0, -200.0] if offset > 0 else [0.0, 0.0]
    chain = BufferedChain(
        masses=2, frequency=0.9, offset=offset, harmonic_forces=forces, constant_forces=weight
    )
    start = chain.state([0.5, offset], [0.0, 0.09]) if offset > 0 else chain.state([0.5, 0.5])
    record = chain.simulate(impacts=5, start=start)
    assert record.ending is Ending.SEARCH_LIMIT
    assert 100 <= len(record._run.switches.time) <= 300
    assert bool(len(record.sticking)) is (offset > 0)
    more = chain.simulate(impacts=5, start=record.final)
    assert more.ending is Ending.SEARCH_LIMIT
