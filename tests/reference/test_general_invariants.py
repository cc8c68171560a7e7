"""The reference of any impact oscillator keeps what mechanics keeps, whatever its precision."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from tests.reference.general_oscillator import GeneralOscillator, History, chain_of
from tests.reference.mode_bounds import to_mpf

DIGITS = 80
CLOSE = mpf("1e-50")

MASS = [[2.0, 0.25, 0.0], [0.25, 1.0, 0.125], [0.0, 0.125, 0.5]]
STIFFNESS = [[3.0, -1.0, 0.0], [-1.0, 1.5, -0.5], [0.0, -0.5, 0.5]]
DAMPING = [[0.5, -0.125, 0.0], [-0.125, 0.125, 0.0], [0.0, 0.0, 0.25]]
NONE = [[0.0] * 3 for _ in range(3)]
START = [0.5, -0.25, 1.0], [0.25, 0.75, -0.5]


def general(damping: Any = DAMPING, **changes: Any) -> GeneralOscillator:
    """Three masses with coupled inertia, damping of its own, forces on all, a moving table."""
    parameters: dict[str, Any] = {
        "frequency": 1.25,
        "restitution": 0.75,
        "amplitude": 0.25,
        "offset": -0.25,
        "harmonic_forces": [0.5, 0.25j, -0.125 + 0.5j],
        "constant_forces": [0.5, 0.0, -0.25],
    }
    return GeneralOscillator(MASS, damping, STIFFNESS, **(parameters | changes))


@cache
def motion(
    restitution: float, impacts: int, far_stop: float | None = None
) -> tuple[GeneralOscillator, History]:
    """The motion from the start, which several tests look at."""
    oscillator = general(restitution=restitution, far_stop=far_stop)
    return oscillator, oscillator.simulate(*START, impacts=impacts)


def quadratic(matrix: Any, x: Any) -> Any:
    return (x.T * mpmath.matrix(matrix) * x)[0]


def energy(position: Any, velocity: Any, constant: Any) -> Any:
    x, v = mpmath.matrix(position), mpmath.matrix(velocity)
    work = sum((g * y for g, y in zip(constant, position, strict=True)), mpf(0))
    return (quadratic(MASS, v) + quadratic(STIFFNESS, x)) / 2 - work


def distance(one: Any, other: Any) -> Any:
    """Largest difference of two impacts."""
    with mp.workdps(DIGITS):
        pairs = [(one.time, other.time), (one.relative_velocity, other.relative_velocity)]
        pairs += zip(one.position + one.velocity, other.position + other.velocity, strict=True)
        return max(abs(a - b) for a, b in pairs)


# --- the exponential and its rounding ------------------------------------------------------------


@pytest.mark.parametrize("duration", [2.0**-30, 0.3, 57.125])
def test_the_motion_is_the_matrix_exponential_of_mpmath(duration: float) -> None:
    motion = general().flight
    with ctx.workprec(640), mp.workdps(DIGITS):
        start = arb_mat([[arb(k + 1) / 8] for k in range(9)])
        found = motion.move(start, arb(duration))
        matrix = mpmath.matrix([[to_mpf(x) for x in row] for row in motion.matrix.table()])
        exact = mpmath.expm(matrix * mpf(duration)) * mpmath.matrix([(k + 1) / 8 for k in range(9)])
        assert max(abs(to_mpf(found[k, 0]) - exact[k]) for k in range(9)) < mpf("1e-70")


EXTREME: dict[str, tuple[list[float], list[float], float, float]] = {
    "stiff wall": ([1.0, 1.0], [1e12, 1.0], 0.0, 0.87),
    "stiff tip": ([1.0, 1.0], [1.0, 1e12], 0.1, 0.87),
    "light tip": ([1.0, 1e-12], [1.0, 1.0], 0.0, 0.87),
    "heavy tip": ([1.0, 1e12], [1.0, 1.0], 0.0, 0.87),
    "light inner mass": ([1e-12, 1.0], [1.0, 1.0], 0.1, 0.87),
    "overdamped": ([1.0, 1.0, 1.0], [1.0, 1.0, 1.0], 1e3, 0.87),
    "fast table": ([1.0, 1.0], [1.0, 1.0], 0.1, 1e6),
    "slow table": ([1.0, 1.0], [1.0, 1.0], 0.1, 1e-6),
}


@pytest.mark.parametrize("name", EXTREME)
def test_more_bits_change_nothing_in_fifty_digits(name: str) -> None:
    masses, springs, damping, frequency = EXTREME[name]
    start = [0.5] * len(masses), [0.0] * len(masses)
    few, many = (
        chain_of(masses, springs, damping, frequency=frequency, restitution=0.85, amplitude=0.1,
                 bits=bits).simulate(*start, impacts=4)
        for bits in (768, 1024)
    )  # fmt: skip
    assert len(few.impacts) == len(many.impacts) == 4
    for one, other in zip(few.impacts, many.impacts, strict=True):
        assert distance(one, other) < CLOSE * max(mpf(1), other.time)


# --- energy, momentum, time ----------------------------------------------------------------------


def test_undamped_elastic_motion_keeps_its_energy() -> None:
    constant = [0.5, 0.0, -0.25]
    oscillator = general(NONE, restitution=1.0, amplitude=0.0, harmonic_forces=())
    history = oscillator.simulate(*START, impacts=25)
    with mp.workdps(DIGITS):
        start = energy(*START, constant)
        for impact in history.impacts:
            assert abs(energy(impact.position, impact.velocity, constant) - start) < CLOSE


def test_energy_is_lost_in_dashpots_and_impacts_alone() -> None:
    oscillator = general()
    history = oscillator.simulate(*START, impacts=3)
    constant = [0.5, 0.0, -0.25]
    with mp.workdps(30):
        inverse = mpmath.matrix(MASS) ** -1
        forces = [mpf("0.5"), mpmath.mpc(0, "0.25"), mpmath.mpc("-0.125", "0.5")]

        def power(time: Any) -> Any:
            _, velocity = oscillator.state_at(history, time)
            turn = mpmath.expj(mpf("1.25") * time)
            given = sum((f * turn).imag * v for f, v in zip(forces, velocity, strict=True))
            return given - quadratic(DAMPING, mpmath.matrix(velocity))

        for one, other in pairwise(history.impacts):
            middle = [one.time + (other.time - one.time) * k / 4 for k in range(5)]
            middle[-1] = other.time * (1 - mpf("1e-25"))
            work = mpmath.quad(power, middle)
            approach = other.relative_velocity / mpf("0.75")
            table = mpf("0.25") * mpf("1.25") * mpmath.cos(mpf("1.25") * other.time)
            # The impulse times the mean velocity of the contact point.
            impulse = mpf("1.75") * approach / inverse[2, 2]
            work += impulse * (table + (other.relative_velocity - approach) / 2)
            gain = energy(other.position, other.velocity, constant)
            gain -= energy(one.position, one.velocity, constant)
            assert abs(gain - work) < mpf("1e-20")


@pytest.mark.parametrize("far_stop", [None, 1.25])
def test_undamped_elastic_motion_runs_backwards(far_stop: float | None) -> None:
    # t -> -t turns the phase into pi - phase and F into its conjugate.
    forces = [0.5, 0.25j, -0.125 + 0.5j]
    forth = general(NONE, restitution=1.0, far_stop=far_stop)
    history = forth.simulate(*START, impacts=12)
    with mp.workdps(200):
        turned = (history.impacts[-2].time + history.impacts[-1].time) / 2
        position, velocity = forth.state_at(history, turned)
        back = general(
            NONE,
            restitution=1.0,
            far_stop=far_stop,
            harmonic_forces=[complex(f).conjugate() for f in forces],
        )
        phase = mp.pi - mpf("1.25") * turned
        again = back.simulate(position, [-v for v in velocity], phase, impacts=11)
        for one, other in zip(history.impacts[-2::-1], again.impacts, strict=True):
            assert one.side == other.side
            assert abs(turned - one.time - other.time) < CLOSE
            assert abs(one.relative_velocity - other.relative_velocity) < CLOSE
    assert {p.side for p in history.impacts} == ({"near"} if far_stop is None else {"near", "far"})


# --- symmetries ----------------------------------------------------------------------------------


def test_from_below_everything_is_mirrored() -> None:
    # The table moves with the phase: half a turn mirrors it, and the forces with it.
    mirrored = general(side="below", offset=0.25, constant_forces=[-0.5, 0.0, 0.25])
    ours = general().simulate(*START, impacts=20).impacts
    position, velocity = [-x for x in START[0]], [-x for x in START[1]]
    with mp.workdps(200):
        theirs = mirrored.simulate(position, velocity, +mp.pi, impacts=20).impacts
    for one, other in zip(ours, theirs, strict=True):
        assert abs(one.time - other.time) < CLOSE
        assert abs(one.relative_velocity - other.relative_velocity) < CLOSE
        assert abs(one.position[0] + other.position[0]) < CLOSE


def test_either_stop_can_be_called_the_near_one() -> None:
    # Pushed hard enough to stick to both.
    push = {"harmonic_forces": [0.5, 0.25j, 4.0], "restitution": 0.25}
    ours = general(far_stop=1.0625, **push).simulate(*START, impacts=120)
    theirs = general(side="below", offset=1.0625, far_stop=-0.25, **push)
    other = theirs.simulate(*START, impacts=120)
    swap = {"near": "far", "far": "near"}
    assert {contact.side for contact in ours.contacts} == {"near", "far"}
    for one, two in zip(ours.impacts, other.impacts, strict=True):
        assert one.side == swap[two.side]
        assert distance(one, two) < CLOSE
    for contact, same in zip(ours.contacts, other.contacts, strict=True):
        assert contact.side == swap[same.side]
        assert abs(contact.start - same.start) < CLOSE


def test_the_contact_coordinate_can_be_any() -> None:
    order = [2, 0, 1]
    parts = [[[part[i][j] for j in order] for i in order] for part in (MASS, DAMPING, STIFFNESS)]
    forces = [0.5, 0.25j, -0.125 + 0.5j]
    other = GeneralOscillator(
        parts[0],
        parts[1],
        parts[2],
        frequency=1.25,
        restitution=0.25,
        amplitude=0.25,
        offset=-0.25,
        contact=0,
        harmonic_forces=[forces[i] for i in order],
        constant_forces=[-0.25, 0.5, 0.0],
    )
    start = [[part[i] for i in order] for part in START]
    _, ours = motion(0.25, 150)
    theirs = other.simulate(start[0], start[1], impacts=150)
    assert len(ours.contacts) == len(theirs.contacts) > 0
    for one, two in zip(ours.contacts, theirs.contacts, strict=True):
        assert abs(one.release - two.release) < CLOSE
    for a, b in zip(ours.impacts, theirs.impacts, strict=True):
        assert abs(a.time - b.time) < CLOSE
        assert abs(a.velocity[0] - b.velocity[1]) < CLOSE


# --- gaps, contact, release ----------------------------------------------------------------------


def gap_at(oscillator: GeneralOscillator, history: History, time: Any) -> Any:
    position, _ = oscillator.state_at(history, time)
    return position[-1] - mpmath.sin(mpf("1.25") * time) / 4 + mpf("0.25")


@pytest.mark.parametrize("restitution", [0.0, 0.25, 0.75, 1.0])
def test_gaps_are_never_negative(restitution: float) -> None:
    oscillator, history = motion(restitution, 100, 1.0625)
    last = float(history.impacts[-1].time)
    with mp.workdps(DIGITS):
        gaps = [gap_at(oscillator, history, t) for t in np.linspace(0.0, last, 400)[:-1].tolist()]
    assert min(gaps) > -CLOSE
    assert max(gaps) < mpf(1.3125) + CLOSE
    assert {p.side for p in history.impacts} == {"near", "far"}


@pytest.mark.parametrize("restitution", [0.0, 0.25])
def test_release_is_where_the_free_acceleration_is_that_of_the_table(restitution: float) -> None:
    oscillator, history = motion(restitution, 150)
    with mp.workdps(DIGITS):
        inverse = mpmath.matrix(MASS) ** -1
        forces = [mpf("0.5"), mpmath.mpc(0, "0.25"), mpmath.mpc("-0.125", "0.5")]
        for contact in (history.contacts[0], history.contacts[-1]):

            def missing(time: Any) -> Any:
                """Acceleration of the table, less that of the mass without its contact force."""
                x, v = map(mpmath.matrix, oscillator.state_at(history, time))
                turn = mpmath.expj(mpf("1.25") * time)
                f = mpmath.matrix([(z * turn).imag for z in forces]) + mpmath.matrix(
                    [0.5, 0, -0.25]
                )
                f -= mpmath.matrix(DAMPING) * v + mpmath.matrix(STIFFNESS) * x
                return -mpf("0.25") * mpf("1.5625") * turn.imag - (inverse * f)[2]

            assert abs(missing(contact.release)) < CLOSE
            length = contact.release - contact.start
            times = [contact.start + length * k / 20 for k in range(1, 20)]
            assert all(missing(time) > 0 for time in times)


def test_the_cut_of_a_chatter_costs_nothing_in_fifty_digits() -> None:
    _, history = motion(0.25, 150)
    assert 0 < history.chatter_error < mpf("1e-58")


# --- what cannot be decided, and starts ----------------------------------------------------------


def test_a_grazing_is_not_decided() -> None:
    # x = cos t touches -1.
    oscillator = chain_of([1.0], [1.0], 0.0, frequency=1.0, restitution=0.5, offset=-1.0)
    with pytest.raises(ArithmeticError, match="grazing"):
        oscillator.simulate([1.0], [0.0])


@pytest.mark.parametrize("stiffness", [1.0, 2.0**-36])
def test_a_return_to_the_stop_with_velocity_zero_is_not_decided(stiffness: float) -> None:
    # A weight takes the mass off the stop, where restitution 0 left it; the spring brings it back.
    oscillator = chain_of(
        [1.0],
        [stiffness],
        0.0,
        frequency=1.0,
        restitution=0.0,
        side="below",
        constant_forces=[-(2.0**-20)],
    )
    history = oscillator.simulate([-0.125], [-0.0625])
    assert history.impacts[0].relative_velocity == 0
    with pytest.raises(ArithmeticError, match="grazing"):
        oscillator.simulate([-0.125], [-0.0625], impacts=2)


@pytest.mark.parametrize("above", [1e-9, 1e-15, -1e-9, -1e-15])
def test_a_near_grazing_is_decided(above: float) -> None:
    oscillator = chain_of([1.0], [1.0], 0.0, frequency=1.0, restitution=0.5, offset=-1.0 - above)
    history = oscillator.simulate([1.0], [0.0])
    if above > 0:
        assert history.ending == "no further contact"
    else:
        with mp.workdps(DIGITS):
            assert abs(history.impacts[0].time - mpmath.acos(mpf(-1.0 - above))) < CLOSE


def test_a_mass_without_force_rests_on_the_table() -> None:
    oscillator = chain_of([1.0, 1.0], [1.0, 1.0], 0.0, frequency=1.0, restitution=0.5)
    history = oscillator.simulate([0.0, 0.0], [0.0, 0.0])
    assert history.ending == "contact for ever"


@pytest.mark.parametrize(("position", "velocity"), [(-0.5, 0.0), (0.0, -1.0), (2.5, 0.0)])
def test_a_start_beyond_a_stop_is_refused(position: float, velocity: float) -> None:
    oscillator = GeneralOscillator([[1]], [[0]], [[1]], 1.0, 0.5, far_stop=2.0)
    with pytest.raises(ValueError, match=r"beyond the (near|far) stop"):
        oscillator.simulate([position], [velocity])


def test_stops_that_cross_are_refused() -> None:
    with pytest.raises(ValueError, match=r"far_stop must lie beyond offset 0\.5; got 0\.25"):
        GeneralOscillator([[1]], [[0]], [[1]], 1.0, 0.5, offset=0.5, far_stop=0.25)


def test_times_after_the_last_impact_are_refused() -> None:
    oscillator = general()
    history = oscillator.simulate(*START, impacts=1)
    with pytest.raises(ValueError, match="time must not be after"):
        oscillator.state_at(history, 100.0)
