"""The reference chain agrees with closed forms, and with its stored values."""

from itertools import pairwise
from math import acos, exp, pi, sqrt

import mpmath
import pytest
from mpmath import mp, mpf

from tests.reference.impact_chain import ReferenceChain
from tests.reference.values import PAPER_CHAIN, regenerate


def test_one_undamped_mass_returns_every_half_period() -> None:
    # Elastic impacts on a table at rest at the spring's zero: half a period of flight, for ever.
    chain = ReferenceChain(1, damping=0.0, restitution=1.0, amplitude=0.0, frequency=1.0)
    history = chain.simulate(20, [1.0], [0.0])
    with mp.workdps(60):
        errors = [abs(p.time - (k + mpf(1) / 2) * mp.pi) for k, p in enumerate(history.impacts)]
    assert max(errors) < mpf("1e-45")


def test_undamped_elastic_chain_keeps_its_energy() -> None:
    chain = ReferenceChain(3, damping=0.0, restitution=1.0, amplitude=0.0, frequency=1.0)
    history = chain.simulate(30)
    with mp.workdps(60):
        energies = []
        for p in history.impacts:
            stretch = [p.position[0], *(b - a for a, b in pairwise(p.position))]
            energies.append(sum(v * v for v in p.velocity) + sum(d * d for d in stretch))
    assert max(energies) - min(energies) < mpf("1e-45")


def test_one_damped_mass_flies_its_closed_form() -> None:
    chain = ReferenceChain(1, damping=0.2, restitution=0.5, amplitude=0.0, frequency=1.0)
    first = chain.simulate(1, [1.0], [0.0]).impacts[0]
    rate = sqrt(1.0 - 0.1**2)
    time = (pi - acos(0.1)) / rate
    assert float(first.time) == pytest.approx(time, abs=2e-15)
    assert float(first.relative_velocity) == pytest.approx(0.5 * exp(-0.1 * time), abs=2e-16)


def test_every_proved_root_is_a_root_in_mpmath() -> None:
    history = ReferenceChain(frequency=0.87).simulate(20)
    assert history.worst_newton_step < mpf("1e-60")


def test_contact_of_one_mass_ends_where_the_table_pulls_away() -> None:
    # One mass without damping on the table: force w-balance (1 - w^2) A sin + A0 = 0.
    chain = ReferenceChain(
        1, damping=0.0, restitution=0.0, amplitude=0.5, offset=0.2, frequency=0.5
    )
    history = chain.simulate(2, [2.0], [0.0])
    _, release = history.contacts[0]
    with mp.workdps(60):
        phase = mp.pi + mpmath.asin(mpf(0.2) / (mpf("0.75") * mpf("0.5")))
        late = mpmath.fmod(release / 2 - phase, 2 * mp.pi)
    assert abs(late) < mpf("1e-45")


def test_release_does_not_depend_on_the_cut_of_the_chatter() -> None:
    ends = [
        ReferenceChain(2, frequency=0.408, restitution=0.3, stick_below=cut)
        .simulate(60)
        .contacts[0][1]
        for cut in (1e-15, 1e-23)
    ]
    assert abs(ends[0] - ends[1]) < mpf("1e-27")


def test_a_table_out_of_reach_ends_the_motion() -> None:
    history = ReferenceChain(3, offset=-5.0).simulate(5)
    assert history.ending == "no further contact"


def test_a_light_shake_ends_in_contact_for_ever() -> None:
    chain = ReferenceChain(2, amplitude=0.01, offset=0.5, restitution=0.0, frequency=0.3)
    assert chain.simulate(50, [1.0, 1.0], [0.0, 0.0]).ending == "contact for ever"


@pytest.mark.parametrize("frequency", [0.35, 0.87])
def test_stored_values_are_regenerated(frequency: float) -> None:
    assert regenerate(frequency, 10) == PAPER_CHAIN[frequency, 10]
