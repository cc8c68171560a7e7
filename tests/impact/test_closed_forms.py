"""Motions of machines whose closed forms are known, mirrored machines, and extremes."""

from dataclasses import replace
from math import atan2, cos, exp, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest
from mpmath import mp
from scipy.linalg import expm

import dynkit
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop
from tests.effort import some
from tests.impact.test_friction import random_machine


def two_walls(along: Any, clearance: float, restitution: float, **moving: Any) -> list[HardStop]:
    half = 0.5 * clearance
    return [
        HardStop(along, offset=-half, restitution=restitution, **moving),
        HardStop(along, offset=half, restitution=restitution, side="below", **moving),
    ]


@pytest.mark.parametrize(("clearance", "restitution"), [(1.2, 0.5), (2.0, 0.7), (0.6, 0.3)])
def test_an_impact_pair_moves_symmetrically_as_its_closed_form_says(
    clearance: float, restitution: float
) -> None:
    # From wall to wall in half a period: V pi/w = d - 2 A sin(phase), and the law of impacts asks
    # for V = A w cos(phase) (1 + r)/(1 - r).
    a, w, d, r = 0.5, 1.3, clearance, restitution
    gain = (1.0 + r) / (1.0 - r)
    size, lag = a * sqrt((pi * gain) ** 2 + 4.0), atan2(2.0, pi * gain)
    phase = lag - np.arccos(d / size)
    speed = a * w * cos(phase) * gain
    # The half of a period, mirrored, takes (phase, V) to (phase, V):
    by_time = -np.array([2.0 * a * cos(phase), pi / w]) / (speed + a * w * cos(phase))
    next_phase = np.array([1.0, 0.0]) + w * by_time
    next_speed = a * w * sin(phase) * (1.0 + r) * next_phase - r * np.array([0.0, 1.0])
    multipliers = np.linalg.eigvals(np.array([next_phase, -next_speed])) ** 2
    pair = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=w,
        elements=two_walls(0, d, r, amplitude=a),
    )
    found = np.array([0.0, phase % (2 * pi)])  # near it, just after the first wall
    found[0] = speed - a * w * cos(phase)
    image = pair.iterate(found, 2)[2]
    assert abs(pair.difference(image, found)).max() < 1e-13
    jacobian = pair.jacobian(pair(found)) @ pair.jacobian(found)
    assert sorted(abs(np.linalg.eigvals(jacobian))) == pytest.approx(sorted(abs(multipliers)))
    if abs(multipliers).max() < 0.95:
        start = pair.impact_state(found + 0.01)
        label = pair.attractor(start=start, transient=400, keep=20).label
        assert str(label) == "P(2,1)"
        assert label.multiplier == pytest.approx(abs(multipliers).max(), rel=1e-8)


def within(damper: MatrixOscillator, x: float, speed: float, ball: float, asked: Array) -> bool:
    """Whether the ball stays between the walls in the half of a period after an impact."""
    c, d = damper.damping_matrix[0, 0], -2.0 * damper.elements[0].offset
    times = np.linspace(0.0, pi, 400)[1:-1]
    generator = np.array([[0.0, 1.0], [-1.0, -c]])
    free = np.array([(expm(generator * t) @ ([x, speed] - asked))[0] for t in times])
    place = free + asked[0] * np.cos(times) + asked[1] * np.sin(times)
    return bool((abs(x - 0.5 * d + ball * times - place) < 0.5 * d).all())


@pytest.mark.parametrize(
    ("ratio", "restitution", "clearance"), [(0.1, 0.6, 12.0), (0.2, 0.8, 9.0), (0.05, 0.3, 14.0)]
)
def test_an_impact_damper_moves_symmetrically_as_its_closed_form_says(
    ratio: float, restitution: float, clearance: float
) -> None:
    # S. F. Masri, T. K. Caughey, J. Appl. Mech. 33 (1966) 586-592: two impacts in each period, half
    # of one apart. All follows from the place of the first mass at an impact, by a quadratic.
    w, c, m, r, d = 1.0, 0.1, ratio, restitution, clearance
    half = pi / w
    flow = expm(half * np.array([[0.0, 1.0], [-1.0, -c]]))
    response = 1.0 / (1.0 - w * w + 1j * c * w)

    def after(x: float) -> tuple[Array, float, float]:
        """The forced response (2,) there, the speed of the ball, and that of the mass."""
        ball = (d - 2.0 * x) / half
        speed = ball * (1.0 - r - 2.0 * r * m) / (1.0 + r)
        before = -speed - 2.0 * m * ball
        asked = flow @ [x, speed] + [x, -before]
        return np.asarray(np.linalg.solve(flow + np.eye(2), asked)), ball, speed

    origin, slope = after(0.0)[0], after(1.0)[0] - after(0.0)[0]
    scale = np.array([1.0, 1.0 / w])
    origin, slope = origin * scale, slope * scale
    quadratic = [slope @ slope, 2.0 * (origin @ slope), origin @ origin - abs(response) ** 2]
    damper = MatrixOscillator(
        M=np.diag([1.0, m]),
        C=[[c, 0.0], [0.0, 0.0]],
        K=[[1.0, 0.0], [0.0, 0.0]],
        frequency=w,
        harmonic_forces=[1.0, 0.0],
        elements=two_walls((0, 1), d, r),
    )
    checked = 0
    for x in np.roots(quadratic):
        if abs(x.imag) > 0.0:
            continue
        place = float(x.real)
        asked, ball, speed = after(place)
        if not within(damper, place, speed, ball, asked):
            continue
        turn = atan2(asked[0], asked[1] / w) - np.angle(response)
        section = np.array([place, speed, ball - speed, turn % (2.0 * pi)])
        image = damper.iterate(section, 2)[2]
        assert abs(damper.difference(image, section)).max() < 1e-11
        checked += 1
        record = damper.simulate(impacts=2, start=damper.impact_state(section))
        assert record.element.tolist() == [1, 0]
        assert record.time == pytest.approx([half, 2.0 * half], rel=1e-12)
        # Stability: the mirrored half of a period, by flow and saltation.
        generator = np.zeros((4, 4))
        generator[0, 2] = generator[1, 3] = 1.0
        generator[2, 0], generator[2, 2] = -1.0, -c
        kick = np.array([-1.0, 1.0 / m]) / (1.0 + 1.0 / m)
        reset = np.eye(4)
        reset[2:, 2:] -= (1.0 + r) * np.outer(kick, [-1.0, 1.0])
        before = np.array([-place, -place + 0.5 * d, -speed - 2.0 * m * ball, ball])
        push = np.array([0.0, 0.0, sin(turn + pi), 0.0])
        gap = np.array([-1.0, 1.0, 0.0, 0.0])
        rate = generator @ before + push
        jump = generator @ reset @ before + push - reset @ rate
        saltation = reset + np.outer(jump, gap) / (gap @ rate)
        multipliers = np.linalg.eigvals(saltation @ expm(half * generator)) ** 2
        jacobian = damper.jacobian(damper(section)) @ damper.jacobian(section)
        found = sorted(abs(np.linalg.eigvals(jacobian)))
        assert found == pytest.approx(sorted(abs(multipliers)), rel=1e-6, abs=1e-8)
    assert checked >= 1


def test_the_forced_response_of_an_undamped_bilinear_oscillator_is_that_of_matching() -> None:
    # x = 0 at the phases at which the stop is met and left; the velocities agree there.
    w, k = 0.7, 3.0
    machine = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=w,
        harmonic_forces=[1.0],
        elements=[SoftStop(0, stiffness=k)],
    )
    damped = machine.replace(damping=0.2).attractor(transient=200, keep=5).states[-1]
    orbit = dynkit.periodic_orbit(machine, damped, period=1)
    (state,) = orbit.states
    record = machine.simulate(impacts=1, start=machine.impact_state(state))
    with mp.workdps(30):

        def piece(square: Any, begin: Any, end: Any) -> tuple[Any, Any]:
            """Velocities at both ends of a motion from zero to zero, driven by sin(w t)."""
            own, size = mp.sqrt(square), 1 / (square - mp.mpf(w) ** 2)
            x0, x1 = -size * mp.sin(w * begin), -size * mp.sin(w * end)
            angle = own * (end - begin)
            b = (x1 - x0 * mp.cos(angle)) / mp.sin(angle)
            v0 = own * b + size * w * mp.cos(w * begin)
            v1 = own * (b * mp.cos(angle) - x0 * mp.sin(angle)) + size * w * mp.cos(w * end)
            return v0, v1

        def matching(met: Any, left: Any) -> tuple[Any, Any]:
            inside = piece(mp.mpf(1 + k), met, left)
            outside = piece(mp.mpf(1), left, met + 2 * mp.pi / w)
            return inside[1] - outside[0], outside[1] - inside[0]

        events = record.events
        assert len(events) == 2
        met, left = sorted(events.time, key=lambda t: events.velocity[list(events.time).index(t)])
        if left < met:
            left += 2 * pi / w
        root = mp.findroot(matching, (met, left))
        exact = sorted(float(t) % (2 * pi / w) for t in root)
    assert sorted(events.time % (2 * pi / w)) == pytest.approx(exact, abs=1e-12)


def restitution_of(zeta: float) -> float:
    """That of a stiff soft stop with a dashpot of 2 zeta sqrt(k), met by a mass of one."""
    # The force is zero again after a time that goes with 1/sqrt(k), and the speed is then
    # exp(-zeta w t1) of that before. So the motions differ by 1/sqrt(k).
    damped = sqrt(1.0 - zeta**2)
    ends = (pi - atan2(2.0 * zeta * damped, 1.0 - 2.0 * zeta**2)) / damped
    return -exp(-zeta * ends) * (cos(damped * ends) - zeta / damped * sin(damped * ends))


def test_stiff_soft_stops_tend_to_the_hard_stop_of_their_restitution() -> None:
    zeta = 0.2
    restitution = restitution_of(zeta)
    table = HardStop(0, offset=-0.2, amplitude=0.1, restitution=restitution)
    hard = ImpactChain(
        masses=1, frequency=2.2, damping=0.05, harmonic_forces=[0.7], elements=[table]
    )
    times = np.linspace(0.0, 12.0, 25)
    start = [0.5], [0.3]
    record = hard.simulate(impacts=20, start=hard.state(*start))
    assert (record.time < times[-1]).sum() >= 3
    expected = record.sample(times)[0][:, 0]
    stiffness, off = 10.0 ** np.arange(4, 13, 2), []
    for k in stiffness:
        soft = SoftStop(0, offset=-0.2, amplitude=0.1, stiffness=k, damping=2 * zeta * sqrt(k))
        machine = hard.replace(elements=[soft])
        motion = machine.simulate(impacts=8, start=machine.state(*start))
        off.append(abs(motion.sample(times)[0][:, 0] - expected).max())
    slope = np.polyfit(np.log(stiffness), np.log(off), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.03)
    assert off[-1] < 1e-4


@pytest.mark.parametrize(("masses", "damping", "impacts"), [(1, 0.0, 4), (3, 0.05, 2)])
def test_orbits_of_stiff_soft_stops_tend_to_those_of_the_hard_stop(
    masses: int, damping: float, impacts: int
) -> None:
    zeta, last = 0.3, masses - 1
    chain = ImpactChain(
        masses=masses,
        damping=damping,
        frequency=0.7,
        harmonic_forces=[0.6] + [0.0] * last,
        elements=[HardStop(last, restitution=restitution_of(zeta))],
    )
    hard = chain.attractor(transient=300).periodic_orbit()
    assert hard.label == f"P({impacts},1)"
    stiffness, off = 10.0 ** np.arange(6, 13, 2), []
    for k in stiffness:
        soft = SoftStop(last, stiffness=k, damping=2.0 * zeta * sqrt(k), name="stop")
        machine = chain.replace(elements=[soft])
        orbit = machine.periodic_orbit(start=machine.simulate(impacts=300).final)
        assert orbit.counts == {"stop.presses": impacts}
        expected = hard.multipliers[: len(orbit.multipliers)]
        off.append(abs(orbit.multipliers - expected).max())
    slope = np.polyfit(np.log(stiffness), np.log(off), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.01)
    assert off[-1] < 1e-5


def mirrored(chain: ImpactChain) -> ImpactChain:
    elements = []
    for element in chain.elements:
        turned = {"offset": -element.offset, "phase": element.phase + pi}
        turned["side"] = "below" if element.side == "above" else "above"
        if isinstance(element, DryFriction):
            turned["velocity"] = -element.velocity
        elements.append(replace(element, **turned))
    return chain.replace(
        elements=elements,
        harmonic_forces=[-force for force in chain.harmonic_forces],
        constant_forces=[-force for force in chain.constant_forces],
    )


@pytest.mark.parametrize("hit", [False, True])
@pytest.mark.parametrize("seed", some(range(16, 32), 2))
def test_mirrored_and_reordered_machines_with_friction_move_alike(seed: int, hit: bool) -> None:
    chain, place, velocity = random_machine(seed, hit=hit)
    record = chain.simulate(impacts=6, start=chain.state(place, velocity))
    other = mirrored(chain)
    mirror = other.simulate(impacts=6, start=other.state(-place, -velocity))
    turned = chain.replace(elements=chain.elements[::-1])
    again = turned.simulate(impacts=6, start=turned.state(place, velocity))
    for found, sign in ((mirror, -1.0), (again, 1.0)):
        assert len(found) == len(record)
        certain = (record.error < 1e-6) & (found.error < 1e-6)
        allowed = record.error + found.error
        for one, two in ((record.position, found.position), (record.velocity, found.velocity)):
            off = abs(one - sign * two).max(axis=1, initial=0.0)
            assert (off[certain] <= allowed[certain]).all()
        assert certain[0]


def test_fifty_masses_on_ten_sliders() -> None:
    sliders = [
        DryFriction(5 * k, force=0.02, static=0.03, velocity=0.02 * (-1) ** k) for k in range(10)
    ]
    chain = ImpactChain(
        masses=50,
        damping=0.05,
        frequency=0.3,
        harmonic_forces=[0.0] * 49 + [0.5],
        elements=sliders,
    )
    record = chain.simulate(impacts=4, start=chain.state(np.zeros(50), np.zeros(50)))
    assert len(record) == 4
    assert len(record.events) > 20
    balance = record.energy_balance()
    assert balance.error < 1e-11
    assert min(balance.dissipated.values()) >= -1e-14


def test_all_stops_closed_bear_what_lies_on_them() -> None:
    # A pile of five masses of weight one on a table, and each on the one below.
    n = 5
    pile = MatrixOscillator(
        M=np.eye(n),
        C=np.zeros((n, n)),
        K=np.zeros((n, n)),
        frequency=1.0,
        constant_forces=[-1.0] * n,
        elements=[
            HardStop(0, amplitude=0.3, restitution=0.5, name="table"),
            *(HardStop((k, k + 1), restitution=0.5, name=f"on_{k}") for k in range(n - 1)),
        ],
    )
    speed = 0.3
    start = pile.state(np.zeros(n), np.full(n, speed))
    record = pile.simulate(impacts=5, start=start)
    assert record.ending.name == "CONTACT_FOR_EVER"
    times = np.linspace(0.0, 20.0, 50)
    assert record.sample(times)[0] == pytest.approx(
        np.tile(0.3 * np.sin(times)[:, None], n), abs=1e-13
    )
    weight = 1.0 - 0.3 * np.sin(times)
    for k, name in enumerate(["table", *(f"on_{k}" for k in range(n - 1))]):
        force = record.observable(f"{name}.contact_force", times)
        assert force == pytest.approx((n - k) * weight, abs=1e-12)


def test_the_motion_of_a_beam_on_three_supports_is_one_answer_and_so_are_its_forces() -> None:
    # Two coordinates, three stops: only two of them are closed at once, and the record says that
    # the outcome is a choice of law.
    beam = MatrixOscillator(
        M=np.diag([1.0, 0.3]),
        C=np.zeros((2, 2)),
        K=np.zeros((2, 2)),
        frequency=1.0,
        constant_forces=[-1.0, 0.0],
        elements=[
            HardStop([1.0, -1.0], restitution=0.5, name="left"),
            HardStop([1.0, 0.0], restitution=0.5, name="middle"),
            HardStop([1.0, 1.0], restitution=0.5, name="right"),
        ],
    )
    record = beam.simulate(impacts=2000, start=beam.state([0.5, 0.1], [0.0, 0.0]))
    assert record.ending.name == "CONTACT_FOR_EVER"
    assert record.ambiguous is not None
    assert np.isinf(record.error[-1])
    late = [float(record.time[-1]) + 5.0]
    assert abs(record.sample(late)[0]).max() < 1e-12
    forces = [record.observable(f"{k}.contact_force", late)[0] for k in ("left", "middle", "right")]
    assert forces == pytest.approx([0.5, 0.0, 0.5], abs=1e-12)
