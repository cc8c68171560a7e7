"""Machines without hard stops: their section is where a period of the forcing begins."""

from math import atan2, exp, pi, sqrt

import numpy as np
import pytest
from scipy.linalg import expm

import dynkit
from dynkit.analysis import POD, LyapunovSpectrum
from dynkit.systems import HardStop, ImpactChain, MatrixOscillator, SoftStop

BILINEAR = ImpactChain(
    masses=1,
    frequency=0.8,
    damping=0.05,
    harmonic_forces=[1.0],
    elements=[SoftStop(0, stiffness=3)],
)
MACHINE = ImpactChain(
    masses=3,
    frequency=0.6,
    damping=0.2,
    harmonic_forces=[1.0, 0.0, 0.3j],
    elements=[
        SoftStop((0, 1), offset=-0.1, stiffness=5.0, damping=0.3, name="gear"),
        SoftStop(2, offset=0.4, stiffness=20.0, side="below"),
    ],
)


@pytest.mark.parametrize("stiffness", [0.5, 3.0, 99.0])
def test_the_free_period_of_a_bilinear_oscillator_is_its_closed_form(stiffness: float) -> None:
    period = pi + pi / sqrt(1.0 + stiffness)
    free = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=1.0,
        elements=[SoftStop(0, stiffness=stiffness)],
    )
    start = free.state([0.0], [0.7])
    record = free.simulate(impacts=1000, start=start)
    # Nothing drives it: its section is where the stop is met.
    assert record.time == pytest.approx(pi + period * np.arange(1000), rel=1e-15)
    assert abs(record.states + 0.7).max() < 1e-11
    assert (abs(record.states + 0.7).max(axis=1) <= record.error).all()
    assert len(record.events) == 1999


@pytest.mark.parametrize(("stiffness", "preload"), [(0.0, 2.0), (3.0, 0.5), (99.0, 20.0)])
def test_the_free_period_with_a_preload_is_its_closed_form(
    stiffness: float, preload: float
) -> None:
    # while pressed w^2 = 1 + k about the place p/w^2, of which the mass comes at -v and goes at v
    w, v = sqrt(1.0 + stiffness), 0.7
    period = pi + 2.0 * atan2(v * w, preload) / w
    pad = SoftStop(0, stiffness=stiffness, preload=preload)
    free = ImpactChain(masses=1, damping=0.0, frequency=2 * pi / period, elements=[pad])
    # the period depends on the energy: errors grow with the square of the time
    record = free.simulate(impacts=100, start=free.state([0.0], [v]))
    assert abs(record.states - [0.0, v]).max() < 1e-11
    assert (abs(record.states - [0.0, v]).max(axis=1) <= record.error).all()


def test_a_stop_that_is_never_pressed_leaves_the_linear_response() -> None:
    w, c, force = 0.8, 0.3, 1.5
    linear = ImpactChain(
        masses=1,
        frequency=w,
        damping=c,
        harmonic_forces=[force],
        elements=[SoftStop(0, offset=-50.0, stiffness=2.0)],
    )
    attractor = linear.attractor(transient=200, keep=20)
    response = force / (1.0 - w * w + 1j * c * w)
    expected = [response.imag, w * response.real]
    assert abs(attractor.states - expected).max() < 1e-13
    assert str(attractor.label) == "P(1,1)"
    assert abs(attractor.label.multiplier) == pytest.approx(exp(-0.5 * c * 2 * pi / w), rel=1e-9)


def test_the_first_period_ends_where_the_phase_is_zero() -> None:
    start = MACHINE.state([0.0, 0.1, 0.2], phase=1.0)
    record = MACHINE.simulate(impacts=20, start=start)
    period = 2 * pi / 0.6
    first = (2 * pi - 1.0) / 0.6
    assert record.time == pytest.approx(first + period * np.arange(20), rel=1e-15)
    assert not record.phase.any()
    assert abs(np.concatenate(record.sample(record.time), axis=1) - record.states).max() < 1e-12
    assert np.isnan(record.relative_velocity).all()
    assert (record.element == -1).all()
    far = MACHINE.replace(elements=[*MACHINE.elements, HardStop(0, offset=-2.0, restitution=0.5)])
    hit = far.simulate(impacts=1, start=far.state([0.0, 0.1, 0.2], phase=1.0))
    assert len(hit) == 1
    until = hit.time[0]
    times = np.linspace(0.0, 0.999 * until, 30)
    both = [
        np.concatenate(r.sample(times), axis=1) for r in (hit, record) if until < record.time[-1]
    ]
    assert len(both) == 2
    assert abs(both[0] - both[1]).max() < 1e-12


def test_the_map_and_its_derivative() -> None:
    for machine, count in ((BILINEAR, 1), (MACHINE, 3)):
        record = machine.simulate(impacts=40)
        assert len(record.events) > 40
        for y, image in zip(record.states[5:15], record.states[6:16], strict=True):
            assert abs(machine(y) - image).max() < 1e-12
            exact, size = machine.jacobian(y), 1e-6
            for k in range(2 * count):
                step = size * np.eye(2 * count)[k]
                change = (machine(y + step) - machine(y - step)) / (2.0 * size)
                assert abs(exact[:, k] - change).max() < 1e-6 * max(1.0, abs(exact).max())
    # Liouville: the trace of the damping, whatever is pressed without a dashpot
    period = 2 * pi / 0.8
    determinant = np.linalg.det(BILINEAR.jacobian(np.array([0.3, -0.2])))
    assert determinant == pytest.approx(exp(-0.05 * period), rel=1e-12)


def test_pieces_of_a_motion_are_the_motion() -> None:
    whole = MACHINE.simulate(impacts=30)
    final = MACHINE.simulate(impacts=12).final
    again = MACHINE.unpack_state(MACHINE.pack_state(final))
    rest = MACHINE.simulate(impacts=18, start=again)
    assert abs(rest.states - whole.states[12:]).max() < 1e-12
    assert MACHINE.displaced(whole.as_attractor(), 1e-6).position == pytest.approx(
        final.position, abs=10.0
    )


def test_what_is_measured_without_impacts() -> None:
    attractor = BILINEAR.attractor()
    label = attractor.label
    assert str(label) == "P(1,1)"
    spectrum = LyapunovSpectrum(attractor)
    assert spectrum.exponents[0] == pytest.approx(np.log(abs(label.multiplier)), abs=1e-6)
    orbit = dynkit.periodic_orbit(BILINEAR, attractor.states[-1], period=1)
    assert abs(orbit.multipliers).max() == pytest.approx(abs(label.multiplier), abs=1e-6)
    record = MACHINE.simulate(impacts=40)
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 40_001)
    x = record.sample(times)[0]
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6
    assert POD(MACHINE.attractor()).cumulative[-1] == pytest.approx(1.0)
    found = dynkit.sweep(BILINEAR, "frequency", [0.7, 0.8], transient=2000, keep=5, progress=False)
    assert found.observables == ("state[0]",)
    assert found.counts.tolist() == [5, 5]
    assert found.observable("state[0]")[1, -1] == pytest.approx(attractor.states[-1, 0], abs=1e-6)


def test_a_branch_of_bilinear_orbits_passes_its_folds() -> None:
    machine = BILINEAR.replace(frequency=1.6)
    orbit = dynkit.periodic_orbit(machine, machine.attractor().states[-1], period=1)
    branch = dynkit.continue_orbit(
        orbit, "frequency", bounds=(1.0, 2.0), step=0.05, largest_step=0.2
    )
    assert min(branch.parameter) == pytest.approx(1.0, abs=1e-9)
    assert max(branch.parameter) == pytest.approx(2.0, abs=1e-9)


def test_orbits_with_impacts_are_not_of_these_machines() -> None:
    with pytest.raises(NotImplementedError, match="SoftStop"):
        MACHINE.periodic_orbit(phases=[0.1])
    for name in ("restitution", "play", "side"):
        with pytest.raises(ValueError, match=f"{name} must not be given beside elements"):
            BILINEAR.replace(**{name: "below" if name == "side" else 0.5})


def test_a_table_of_its_states_has_a_row_for_each_period() -> None:
    machine = ImpactChain(masses=2, frequency=0.9, elements=[SoftStop(1, stiffness=9.0)])
    record = machine.replace(harmonic_forces=[0.0, 1.0]).simulate(impacts=5)
    table = record.to_pandas()
    assert table.time.to_numpy() == pytest.approx(2.0 * pi / 0.9 * np.arange(1, 6), rel=1e-14)
    assert np.array_equal(table["velocity[1]"], record.velocity[:, 1])
    assert not table.isna().any(axis=None)


def test_a_soft_stop_out_of_reach_leaves_a_linear_structure() -> None:
    stiffness, force = np.array([[2.0, -1.0], [-1.0, 2.0]]), [0.3, 0.1]
    machine = MatrixOscillator(
        M=np.eye(2),
        C=0.1 * stiffness,
        K=stiffness,
        frequency=1.3,
        harmonic_forces=force,
        elements=[SoftStop(0, offset=-1e9, stiffness=1.0)],
    )
    rate = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -0.1 * stiffness]])
    flow = expm(rate * 2.0 * np.pi / 1.3)
    orbit = machine.attractor().periodic_orbit()
    turned = np.linalg.solve(stiffness * (1.0 + 0.13j) - 1.69 * np.eye(2), force)
    expected = np.append(turned.imag, 1.3 * turned.real)
    assert abs(orbit.states[0] - expected).max() <= orbit.error + 1e-15
    assert machine.jacobian(orbit.states[0]) == pytest.approx(flow, abs=1e-14)
    assert np.sort(abs(orbit.multipliers)) == pytest.approx(
        np.sort(abs(np.linalg.eigvals(flow))), abs=1e-13
    )
