"""Events of two elements at the same instant: whether the motion has a derivative there."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from dynkit import NoDerivative, periodic_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, Element, HardStop, ImpactChain, SoftStop
from dynkit.systems.impact.variational.map_derivative import derivatives

START = [0.3, 0.6], [-0.5, 0.2]


class _Pair(ImpactChain):
    """Two masses, each tied to a wall, and a dashpot between the two."""

    def potential(self, x: Any) -> Any:
        return sum(z**2 for z in x) / 2

    def dissipation(self, v: Any) -> Any:
        return sum(z**2 for z in v) / 20


class _Dashpot(_Pair):
    def dissipation(self, v: Any) -> Any:
        return super().dissipation(v) + (v[0] - v[1]) ** 2 / 10


class _Hard(_Pair):
    def potential(self, x: Any) -> Any:
        return super().potential(x) + sum(z**4 for z in x) / 10


class _HardDashpot(_Hard):
    def dissipation(self, v: Any) -> Any:
        return super().dissipation(v) + (v[0] - v[1]) ** 2 / 10


APART, JOINED = [_Pair, _Hard], [_Dashpot, _HardDashpot]


def _machine(kind: Any, elements: Sequence[Element], forces: Sequence[float]) -> ImpactChain:
    made: ImpactChain = kind(masses=2, frequency=1.1, harmonic_forces=forces, elements=elements)
    return made


def _alike(kind: Any, *more: Element) -> ImpactChain:
    """Two masses that move alike, so that both stops are hit at once."""
    stops = [HardStop(k, offset=-0.1, restitution=0.7) for k in (0, 1)]
    return _machine(kind, [*stops, *more], [0.3, 0.3])


def _turning(kind: Any) -> ImpactChain:
    """The first mass hits its stop just as the second one turns against friction."""

    def with_stop(offset: float) -> ImpactChain:
        elements = [HardStop(0, offset=offset, restitution=0.7), DryFriction(1, force=0.05)]
        return _machine(kind, elements, [0.3, 0.5])

    far = with_stop(-0.3)
    events = far.simulate(impacts=2, start=far.state(*START)).events
    turn = int(np.flatnonzero((events.element == 1) & (events.time > 0.1))[0])
    return with_stop(float(events.position[turn, 0]))


def _moved(machine: ImpactChain, change: float, time: float) -> Array:
    """Positions and velocities at a time, of a start that is changed."""
    start = machine.state([0.3, 0.6 + change], [-0.5, 0.2 + 0.3 * change])
    record = machine.simulate(impacts=3, start=start)
    return np.concatenate([np.ravel(part) for part in record.sample([time])])


def _bend(machine: ImpactChain, step: float) -> float:
    """Difference of the derivatives of a motion to both sides, beyond the first impact."""
    start = machine.state(*START)
    time = float(machine.simulate(impacts=1, start=start).time[0]) + 0.05
    here, *sides = (_moved(machine, h, time) for h in (0.0, step, -step))
    return float(abs(sides[0] + sides[1] - 2.0 * here).max() / step)


@pytest.mark.parametrize("kind", JOINED)
def test_the_motion_bends_where_a_dashpot_joins_an_impact_and_friction_that_turns(
    kind: Any,
) -> None:
    machine = _turning(kind)
    assert _bend(machine, 1e-6) == pytest.approx(_bend(machine, 1e-5), rel=0.02)
    with pytest.raises(NoDerivative, match=r"order counts: HardStop\(.*\) and DryFriction"):
        derivatives(machine, machine._run(machine.state(*START), 1, store=True))


@pytest.mark.parametrize("kind", APART)
def test_the_motion_does_not_bend_where_nothing_joins_them(kind: Any) -> None:
    machine = _turning(kind)
    assert _bend(machine, 1e-6) < 0.2 * _bend(machine, 1e-5)
    found = derivatives(machine, machine._run(machine.state(*START), 1, store=True))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("kind", JOINED)
def test_two_stops_that_are_hit_at_once_have_no_derivative_where_their_order_counts(
    kind: Any,
) -> None:
    machine = _alike(kind)
    record = machine.simulate(impacts=8, start=machine.state([0.3, 0.3]))
    for state in record.states[1:6:2]:  # the other impact has just happened
        with pytest.raises(NoDerivative, match="order counts"):
            machine.jacobian(state)
        with pytest.raises(NoDerivative, match="order counts"):
            machine.stretching(state, 4)
    with pytest.raises(ValueError, match="order counts"):
        _ = LyapunovSpectrum(record, iterations=128).exponents  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", APART)
def test_two_stops_that_are_hit_at_once_have_one_where_it_does_not(kind: Any) -> None:
    """Two machines of one mass: their derivatives are the blocks of both impacts together."""
    machine = _alike(kind)
    record = machine.simulate(impacts=8, start=machine.state([0.3, 0.3]))
    first = machine.jacobian(record.states[3])
    product = machine.jacobian(record.states[4]) @ first

    class Alone(kind):  # type: ignore[misc]
        pass

    stop = HardStop(0, offset=-0.1, restitution=0.7)
    one = Alone(masses=1, frequency=1.1, harmonic_forces=[0.3], elements=[stop])
    own = one.simulate(impacts=4, start=one.state([0.3])).states
    alone = one.jacobian(own[1])
    # of the second mass, in its velocity and phase
    assert product[-2:, -2:] == pytest.approx(alone, abs=1e-9)


@pytest.mark.parametrize("more", [(), (SoftStop(0, offset=5.0, stiffness=1.0, side="below"),)])
def test_an_orbit_through_both_impacts_has_no_multipliers_where_their_order_counts(
    more: tuple[Element, ...],
) -> None:
    machine = _alike(_Dashpot, *more)
    states = machine.simulate(impacts=400, start=machine.state([0.3, 0.3])).states
    orbit = periodic_orbit(machine, states[-2:])
    assert "no multipliers" in repr(orbit)
    with pytest.raises(NoDerivative, match="order counts"):
        _ = orbit.multipliers


@pytest.mark.parametrize("kind", [_Hard, _HardDashpot])
def test_no_impact_is_missed_where_friction_turns_at_the_same_instant(kind: Any) -> None:
    machine = _turning(kind)
    record = machine.simulate(impacts=3, start=machine.state(*START))
    times = np.linspace(0.0, record.time[-1], 400)
    gaps = np.ravel(record.sample(times)[0][:, 0]) - machine.elements[0].offset
    assert gaps.min() > -1e-12
