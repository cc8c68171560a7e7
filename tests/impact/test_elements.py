"""Elements of one's own: a spring that is touched only, in the engine of the hard stops."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain
from dynkit.systems.impact.elements import SWITCH, Element, EventKind, Regime, Watch
from dynkit.systems.impact.motion import sample_run
from dynkit.systems.impact.record import ImpactRecord
from dynkit.systems.impact.trajectory import Trajectory

DIGITS = 40
SPRING = 7.0
PLACE = 0.05


@dataclass(frozen=True)
class Buffer(Element):
    """A spring that pushes a coordinate while it is beyond a place."""

    coordinate: int
    offset: float
    sign: int
    stiffness: float

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        touched = Watch(SWITCH, to=1, gap=1.0, order=1)
        let_go = Watch(SWITCH, to=0, gap=-self.stiffness, order=1)
        return Regime((touched,)), Regime((let_go,), stiffness=self.stiffness)


@dataclass(frozen=True)
class DampedBuffer(Element):
    """The same with a dashpot: it never pulls, and is left before its gap has closed."""

    coordinate: int
    offset: float
    sign: int
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
    """A chain whose first mass touches a spring, or with a dashpot, that moves with the table."""

    buffer: float = SPRING
    dashpot: float = 0.0

    @property
    def _elements(self) -> tuple[Element, ...]:
        if self.dashpot:
            return *self._stops, DampedBuffer(0, PLACE, 1, self.buffer, self.dashpot)
        return *self._stops, Buffer(0, PLACE, 1, self.buffer)


class Reference:
    """The same motion in many digits: matrix exponentials of (x, v, sine, cosine, one)."""

    def __init__(self, chain: BufferedChain) -> None:
        self.chain, n = chain, chain.degrees_of_freedom
        w, a = mp.mpf(chain.frequency), mp.mpf(chain.amplitude)
        self.flows = []
        for stiffness, drag in ((0, 0), (mp.mpf(chain.buffer), mp.mpf(chain.dashpot))):
            k, c = (mp.matrix(m.tolist()) for m in (chain.stiffness, chain.damping_matrix))
            inverse = mp.matrix(chain.mass.tolist()) ** -1
            k[0, 0] += stiffness
            c[0, 0] += drag
            flow = mp.zeros(2 * n + 3)
            for i in range(n):
                flow[i, n + i] = 1
                for j in range(n):
                    flow[n + i, j] = -(inverse * k)[i, j]
                    flow[n + i, n + j] = -(inverse * c)[i, j]
                flow[n + i, 2 * n] = inverse[i, 0] * stiffness * a
                flow[n + i, 2 * n + 1] = inverse[i, 0] * drag * a * w
                flow[n + i, 2 * n + 2] = inverse[i, 0] * stiffness * mp.mpf(PLACE)
            flow[2 * n, 2 * n + 1], flow[2 * n + 1, 2 * n] = w, -w
            self.flows.append(flow)
        self.gaps = []
        for coordinate, offset in ((n - 1, chain.offset), (0, PLACE)):
            row = mp.zeros(1, 2 * n + 3)
            row[coordinate], row[2 * n], row[2 * n + 2] = 1, -a, -mp.mpf(offset)
            self.gaps.append(row)
        self.inverse = inverse
        gap = self.gaps[1]
        force = -mp.mpf(chain.buffer) * gap - mp.mpf(chain.dashpot) * gap * self.flows[0]
        # of each regime of the spring: what is positive in it, and what follows
        self.watched = [[(gap, 1)], [(force, 2 if chain.dashpot else 0)], [(-force, 1), (-gap, 0)]]

    def impacts(self, start: Array, count: int, step: float = 0.02) -> list[tuple[Any, Any]]:
        """Times and states of so many impacts."""
        n, r = self.chain.degrees_of_freedom, mp.mpf(self.chain.restitution)
        z, time, regime = mp.matrix([*start.tolist(), 0, 1, 1]), mp.mpf(0), 0
        found: list[tuple[Any, Any]] = []
        steps = [mp.expm(flow * mp.mpf(step)) for flow in self.flows]
        while len(found) < count:
            flow = self.flows[regime == 1]
            there = steps[regime == 1] * z
            events = [(self.gaps[0], -1), *self.watched[regime]]
            hit = [(row, after) for row, after in events if (row * there)[0] < 0]
            if not hit:
                z, time = there, time + mp.mpf(step)
                continue
            wait, after = min((self._root(row, flow, z, mp.mpf(step)), k) for row, k in hit)
            z, time = mp.expm(flow * wait) * z, time + wait
            if after >= 0:
                regime = after
            else:
                rate = (self.gaps[0] * flow * z)[0]
                for i in range(n):
                    z[n + i] -= (1 + r) * rate * self.inverse[i, n - 1] / self.inverse[n - 1, n - 1]
                found.append((time, z.copy()))
                for row, after in self.watched[regime]:  # forces of dashpots have jumped
                    if (row * z)[0] < 0:
                        regime = after
                        break
            # past the event by nothing that counts: the next step begins on the other side
            z += mp.mpf(10) ** -(DIGITS - 8) * (self.flows[regime == 1] * z)
        return found

    def _root(self, gap: Any, flow: Any, z: Any, step: Any) -> Any:
        low, high = mp.mpf(0), step
        value = (gap * z)[0]
        for _ in range(12):
            middle = (low + high) / 2
            same = (gap * mp.expm(flow * middle) * z)[0] * value > 0
            low, high = (middle, high) if same else (low, middle)
        t = (low + high) / 2
        for _ in range(6):
            y = mp.expm(flow * t) * z
            t -= (gap * y)[0] / (gap * flow * y)[0]
        return t


def motion(chain: BufferedChain, count: int) -> tuple[Trajectory, Array]:
    start = chain.state()
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
        late = [
            abs(float(mp.mpf(t) - e)) for t, (e, _) in zip(run.time.tolist(), expected, strict=True)
        ]
    x, v = sample_run(chain, run, run.time)
    states = np.array([[float(number) for number in z] for _, z in expected])
    apart = abs(np.concatenate([x, v], axis=1) - states[:, : 2 * masses])
    assert max(late) < 1e-12
    assert apart.max() < 1e-12
    record = ImpactRecord(chain, run)
    again = np.concatenate([record.position, record.velocity], axis=1)
    assert abs(again - states[:, : 2 * masses]).max() < 1e-12


def test_a_motion_does_not_begin_where_such_an_element_acts() -> None:
    chain = BufferedChain(masses=2, frequency=0.9)
    with pytest.raises(Refused, match="a motion must not begin where Buffer"):
        chain.simulate(impacts=1, start=chain.state([-0.5, 1.0]))


def test_contact_is_refused_where_an_element_acts_elsewhere() -> None:
    chain = BufferedChain(masses=2, frequency=0.9)
    with pytest.raises(NotImplementedError, match=r"HardStop.*must not hold"):
        chain._automaton.held(0)


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
            return *self._stops, Buffer(0, PLACE, 1, 3.0), Buffer(0, 0.02, 1, 5.0)

    run, _ = motion(Twice(masses=2, frequency=0.9, restitution=0.6), 5)
    assert len(run.regimes) > 2
    assert len(compiled.signatures) == before


def test_kernels_and_elements_number_events_alike() -> None:
    from dynkit.systems.impact import elements, kernels

    assert (kernels.IMPACT, kernels.SWITCH) == (elements.IMPACT, elements.SWITCH)
