"""The reference of any impact oscillator agrees with closed forms.

Fifty digits are promised. Closed forms are worked out with eighty; what they are compared with
carries more, so that 1e-50 of the largest number (all are of order one here) is the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from tests.reference.general_oscillator import GeneralOscillator, History

DIGITS = 80
CLOSE = mpf("1e-50")


def single(stiffness: float = 1.0, damping: float = 0.0, **parameters: Any) -> GeneralOscillator:
    return GeneralOscillator([[1.0]], [[damping]], [[stiffness]], **parameters)


def bounces(
    position: Callable[[Any, Any, Any, Any], Any],
    table: Callable[[Any], Any],
    history: History,
    start: tuple[float, float],
    restitution: float,
) -> Any:
    """Largest error of times and relative velocities of one mass whose flights are known.

    ``position(t, t0, x0, v0)`` is the flight, ``table(t)`` the stop. The error of a time is what
    Newton's iteration would change.
    """
    with mp.workdps(DIGITS):
        time, x, v, worst = mpf(0), mpf(start[0]), mpf(start[1]), mpf(0)
        for impact in history.impacts:
            flight = (time, x, v)
            assert impact.time > time
            approach = mpmath.diff(lambda t, f=flight: table(t) - position(t, *f), impact.time)
            step = (position(impact.time, *flight) - table(impact.time)) / approach
            time = impact.time + step
            u = restitution * approach
            x, v = table(time), mpmath.diff(table, time) + u
            worst = max(worst, abs(step), abs(u - impact.relative_velocity))
    return worst


# --- a ball --------------------------------------------------------------------------------------


def ball(**parameters: Any) -> GeneralOscillator:
    return single(0.0, constant_forces=[-2.0], frequency=1.0, **parameters)


def test_a_ball_on_a_table_at_rest_bounces_in_a_geometric_series() -> None:
    history = ball(restitution=0.5).simulate([1.0], [0.0], impacts=60)
    with mp.workdps(DIGITS):
        time, u = mpf(1), mpf(1)
        for impact in history.impacts:
            assert abs(impact.time - time) < CLOSE
            assert abs(impact.relative_velocity - u) < CLOSE * u
            time, u = time + u, u / 2


def test_a_ball_comes_to_rest_at_the_zeno_time() -> None:
    history = ball(restitution=0.5).simulate([1.0], [0.0], impacts=1000)
    contact = history.contacts[0]
    assert history.ending == "contact for ever"
    assert len(history.impacts) == 100  # 2^-99 is the first below 1e-30 of the approach at 2
    assert abs(contact.start - 3) < CLOSE
    assert contact.release == mpmath.inf


def test_a_ball_on_a_moving_table_meets_the_root_of_parabola_and_sine() -> None:
    history = ball(restitution=0.75, amplitude=0.5).simulate([1.0], [0.0], impacts=12)
    worst = bounces(
        lambda t, t0, x, v: x + v * (t - t0) - (t - t0) ** 2,
        lambda t: mpmath.sin(t) / 2,
        history,
        (1.0, 0.0),
        0.75,
    )
    assert worst < CLOSE


def test_a_dead_ball_leaves_the_table_when_that_falls_faster() -> None:
    # The second impact finds it falling slower; contact until -w^2 A sin(phase) = -2.
    oscillator = single(
        0.0, constant_forces=[-2.0], frequency=2.0, restitution=0.0, amplitude=1.0, offset=-2.0
    )
    history = oscillator.simulate([0.0], [0.0], impacts=3)
    contact = history.contacts[0]
    with mp.workdps(DIGITS):
        assert contact.start == history.impacts[1].time
        assert abs(mpmath.sin(2 * contact.release) - mpf(1) / 2) < CLOSE
        assert mpmath.cos(2 * contact.release) > 0


def test_a_free_ball_between_two_walls_keeps_its_period() -> None:
    oscillator = single(0.0, frequency=1.0, restitution=1.0, offset=-1.0, far_stop=2.0)
    history = oscillator.simulate([0.0], [0.5], impacts=9)
    assert [p.side for p in history.impacts[:4]] == ["far", "near", "far", "near"]
    assert max(abs(p.time - (4 + 6 * k)) for k, p in enumerate(history.impacts)) < CLOSE


# --- one mass ------------------------------------------------------------------------------------


def test_the_oscillator_of_shaw_and_holmes_flies_its_closed_form() -> None:
    # x'' + 2 z x' + x = b cos(w t), one rigid stop at rest: J. Sound Vib. 90 (1983) 129-155.
    z, b, w = 0.125, 0.75, 2.5
    oscillator = single(
        1.0,
        2 * z,
        harmonic_forces=[b * 1j],
        frequency=w,
        restitution=0.75,
        offset=0.25,
        side="below",
    )
    history = oscillator.simulate([0.0], [0.0], impacts=15)

    def position(t: Any, t0: Any, x0: Any, v0: Any) -> Any:
        response = b / (1 - mpf(w) ** 2 + 2j * z * w)
        turn, rate = response * mpmath.expj(w * t0), mpmath.sqrt(1 - mpf(z) ** 2)
        x, v = x0 - turn.real, v0 - (1j * w * turn).real
        s = t - t0
        free = x * mpmath.cos(rate * s) + (v + z * x) / rate * mpmath.sin(rate * s)
        return mpmath.exp(-z * s) * free + (response * mpmath.expj(w * t)).real

    def mirrored(t: Any, t0: Any, x0: Any, v0: Any) -> Any:
        return -position(t, t0, -x0, -v0)

    assert bounces(mirrored, lambda t: -mpf(0.25) + 0 * t, history, (0.0, 0.0), 0.75) < CLOSE


def test_resonance_grows_like_t_sin_t() -> None:
    # x'' + x = cos t from rest: x = t sin(t) / 2.
    oscillator = single(frequency=1.0, harmonic_forces=[1j], restitution=0.5, offset=-9.0)
    history = oscillator.simulate([0.0], [0.0], impacts=1)
    with mp.workdps(DIGITS):
        time = mpmath.findroot(lambda t: t * mpmath.sin(t) / 2 + 9, mpf("23.1"))
        u = -(mpmath.sin(time) + time * mpmath.cos(time)) / 4
        assert mpf(7) * mp.pi < time < mpf("7.5") * mp.pi
        assert abs(history.impacts[0].time - time) < CLOSE
        assert abs(history.impacts[0].relative_velocity - u) < CLOSE


@pytest.mark.parametrize("damping", [2.0, 2.0 - 2.0**-30, 2.0 + 2.0**-30, 1e3, 1e8])
def test_any_damping_flies_its_closed_form(damping: float) -> None:
    oscillator = single(damping=damping, frequency=1.0, restitution=0.5, amplitude=0.1)
    history = oscillator.simulate([1.0], [0.25], impacts=3)

    def position(t: Any, t0: Any, x0: Any, v0: Any) -> Any:
        z, s = mpf(damping) / 2, t - t0
        if z == 1:
            return mpmath.exp(-s) * (x0 + (v0 + x0) * s)
        rate = mpmath.sqrt(mpmath.mpc(1 - z * z))
        free = x0 * mpmath.cos(rate * s) + (v0 + z * x0) / rate * mpmath.sin(rate * s)
        return (mpmath.exp(-z * s) * free).real

    with mp.workdps(DIGITS):
        duration = max(mpf(1), history.impacts[0].time)
    table = lambda t: mpf(0.1) * mpmath.sin(t)  # noqa: E731
    assert bounces(position, table, history, (1.0, 0.25), 0.5) < CLOSE * duration


def test_contact_of_one_mass_ends_where_the_table_pulls_away() -> None:
    # Force (1 - w^2) A sin(phase) + A0 = 0.
    oscillator = single(frequency=0.5, restitution=0.0, amplitude=0.5, offset=0.25)
    release = oscillator.simulate([2.0], [0.0], impacts=2).contacts[0].release
    with mp.workdps(DIGITS):
        phase = mp.pi + mpmath.asin(mpf(0.25) / mpf(0.375))
        assert abs(mpmath.sin(release / 2 - phase)) < CLOSE
        assert mpmath.cos(release / 2 - phase) > 0


# --- two masses ----------------------------------------------------------------------------------


def test_free_free_masses_collide_like_centre_and_distance() -> None:
    # Masses 3 and 1, spring 12 between them (frequency 4), moving down to a table at rest.
    oscillator = GeneralOscillator(
        [[3, 0], [0, 1]],
        [[0, 0], [0, 0]],
        [[12, -12], [-12, 12]],
        frequency=1,
        restitution=0.5,
    )
    history = oscillator.simulate([1.0, 1.25], [-0.25, 0.5], impacts=8)
    assert history.ending == "no further contact"
    with mp.workdps(DIGITS):
        time, x, v = mpf(0), [mpf(1), mpf(1.25)], [mpf(-0.25), mpf(0.5)]
        for impact in history.impacts:

            def masses(t: Any, t0: Any = time, x: Any = x, v: Any = v) -> tuple[Any, Any]:
                s = t - t0
                centre = (3 * x[0] + x[1]) / 4 + (3 * v[0] + v[1]) / 4 * s
                apart = (x[1] - x[0]) * mpmath.cos(4 * s) + (v[1] - v[0]) / 4 * mpmath.sin(4 * s)
                return centre - apart / 4, centre + 3 * apart / 4

            time = mpmath.findroot(lambda t, f=masses: f(t)[1], mpf(float(impact.time)))
            x = list(masses(time))
            v = [mpmath.diff(lambda t, f=masses, i=i: f(t)[i], time) for i in range(2)]
            v[1] = -v[1] / 2
            assert abs(time - impact.time) < CLOSE
            assert max(abs(a - b) for a, b in zip(v, impact.velocity, strict=True)) < CLOSE
        assert 3 * v[0] + v[1] > 0


@pytest.mark.parametrize("stiffness", [0.058349609375, 3.0, 1e-9])
def test_free_masses_at_rest_fall_onto_the_table_by_their_spring(stiffness: float) -> None:
    # What moves the rigid mode is zero only up to rounding. x_1 = 1 + cos(omega t) above 1/2.
    link = [[stiffness, -stiffness], [-stiffness, stiffness]]
    unit, none = [[1, 0], [0, 1]], [[0, 0], [0, 0]]
    oscillator = GeneralOscillator(
        unit, none, link, frequency=1, restitution=0.5, offset=0.5, contact=1
    )
    history = oscillator.simulate([0.0, 2.0], [0.0, 0.0])
    with mp.workdps(DIGITS):
        expected = 2 * mp.pi / 3 / mpmath.sqrt(2 * mpf(stiffness))
        assert abs(history.impacts[0].time / expected - 1) < CLOSE


def test_momentum_of_free_free_masses_changes_by_the_impulses_alone() -> None:
    oscillator = GeneralOscillator(
        [[3, 0], [0, 1]],
        [[0.5, -0.5], [-0.5, 0.5]],
        [[12, -12], [-12, 12]],
        frequency=2,
        restitution=0.75,
        amplitude=0.125,
        constant_forces=[-3.0, -1.0],
    )
    history = oscillator.simulate([1.0, 1.25], [0.0, 0.0], impacts=20)
    with mp.workdps(DIGITS):
        momentum, time = mpf(0), mpf(0)
        for impact in history.impacts:
            momentum -= 4 * (impact.time - time)
            momentum += impact.relative_velocity / mpf(0.75) * mpf(1.75)
            time = impact.time
            assert abs(3 * impact.velocity[0] + impact.velocity[1] - momentum) < CLOSE


DEFECTIVE = [[16.0, 4.5], [4.5, 4.0]], [[100.0, 0.0], [0.0, 6.25]]
"""Damping and stiffness of unit masses with the fourfold rate -5 and a single mode shape."""


def test_a_defective_state_matrix_flies_its_closed_form() -> None:
    damping, stiffness = DEFECTIVE
    oscillator = GeneralOscillator(
        np.eye(2).tolist(), damping, stiffness, frequency=1.0, restitution=0.5, offset=0.125
    )
    impact = oscillator.simulate([1.0, 0.5], [0.0, -4.0], impacts=1).impacts[0]
    with mp.workdps(DIGITS):
        nilpotent = mpmath.matrix(4)
        for i in range(2):
            nilpotent[i, i], nilpotent[i, 2 + i], nilpotent[2 + i, 2 + i] = 5, 1, 5
            for j in range(2):
                nilpotent[2 + i, j] -= stiffness[i][j]
                nilpotent[2 + i, 2 + j] -= damping[i][j]
        assert mpmath.norm(nilpotent**3) > 1
        assert mpmath.norm(nilpotent**4) == 0
        start = mpmath.matrix([1, 0.5, 0, -4])

        def state(t: Any) -> Any:
            terms = [nilpotent**k * start * t**k / mpmath.factorial(k) for k in range(4)]
            return mpmath.exp(-5 * t) * (terms[0] + terms[1] + terms[2] + terms[3])

        time = mpmath.findroot(lambda t: state(t)[1] - mpf(0.125), mpf(float(impact.time)))
        after = state(time)
        assert abs(time - impact.time) < CLOSE
        assert abs(after[0] - impact.position[0]) < CLOSE
        assert abs(after[2] - impact.velocity[0]) < CLOSE
        assert abs(after[3] / 2 + impact.velocity[1]) < CLOSE


@pytest.mark.parametrize("apart", [0.0, 2.0**-26, 2.0**-40])
def test_coupled_inertia_of_nearly_critical_modes_flies_its_closed_form(apart: float) -> None:
    # x = T q with q_1 critical and q_2 apart from critical: all matrices are exact.
    inverse = mpmath.matrix([[1, -1], [0.5, 0.5]])
    mass, damping, stiffness = (
        (inverse.T * mpmath.diag([1, scale]) * inverse).tolist()
        for scale in (1.0, 1.0 - apart, 1.0)
    )
    damping = [[2 * x for x in row] for row in damping]
    oscillator = GeneralOscillator(
        mass, damping, stiffness, frequency=1.0, restitution=0.5, amplitude=0.25, offset=-0.125
    )
    impact = oscillator.simulate([1.0, 1.0], [0.5, -3.0], impacts=1).impacts[0]
    with mp.workdps(DIGITS):
        shape = inverse**-1
        q, dq = inverse * mpmath.matrix([1, 1]), inverse * mpmath.matrix([0.5, -3])

        def positions(t: Any) -> Any:
            z = 1 - mpf(apart)
            rate = mpmath.sqrt(1 - z * z)
            first = mpmath.exp(-t) * (q[0] + (dq[0] + q[0]) * t)
            sine = mpmath.sin(rate * t) / rate if apart else t
            free = q[1] * mpmath.cos(rate * t) + (dq[1] + z * q[1]) * sine
            return shape * mpmath.matrix([first, mpmath.exp(-z * t) * free])

        def gap(t: Any) -> Any:
            return positions(t)[1] - mpmath.sin(t) / 4 + mpf(0.125)

        time = mpmath.findroot(gap, mpf(float(impact.time)))
        approach = -mpmath.diff(gap, time)
        # The impulse acts on x_2 and moves both masses.
        kick = mpmath.matrix(mass) ** -1
        before = mpmath.diff(lambda t: positions(t)[0], time)
        after = before + kick[0, 1] / kick[1, 1] * mpf(1.5) * approach
        assert abs(time - impact.time) < CLOSE
        assert abs(approach / 2 - impact.relative_velocity) < CLOSE
        assert abs(after - impact.velocity[0]) < CLOSE
