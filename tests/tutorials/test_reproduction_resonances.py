"""The resonances: their branches are where simulation stays, and the rules are what they say."""

from math import pi, sin
from pathlib import Path

import numpy as np
import pytest

from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.resonances import causes, resonances, search
from tutorials.cusumano_bai_1993.resonances.branches import Ridge, contacts_of, energy_error, ridge
from tutorials.cusumano_bai_1993.resonances.causes import (
    RULES,
    bilinear,
    chains,
    drive,
    holding_force,
    mismatch,
    modes_of,
    spread,
)
from tutorials.cusumano_bai_1993.resonances.search import random_starts, shown
from tutorials.cusumano_bai_1993.section import Section
from tutorials.cusumano_bai_1993.workshop import Workshop

PEAK = 0.202
OTHERS = ("$N = 7$", "wall spring 0.2")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Section, Path, Ridge]:
    """The item of one resonance, with few searches and two other chains."""
    folder = tmp_path_factory.mktemp("results")
    known: list[Ridge] = []

    def once(chain: ImpactChain, peak: float) -> Ridge:
        known.append(ridge(chain, peak))
        return known[-1]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(paper, "FREQUENCIES", (0.194, 0.206, 0.002))
        patched.setattr(paper, "PEAKS", (PEAK,))
        patched.setattr(paper, "STICKING", (PEAK, "P(inf,4)"))
        patched.setattr(search, "_PERIODS", (2,))
        patched.setattr(search, "_ELSEWHERE", ())
        patched.setattr(search, "_STARTS", 2)
        patched.setattr(search, "_OTHERS", {"restitution": (0.5,)})
        patched.setattr("tutorials.cusumano_bai_1993.resonances.ridge", once)
        patched.setattr(
            "tutorials.cusumano_bai_1993.resonances.chains",
            lambda workshop: {name: chains(workshop)[name] for name in OTHERS},
        )
        section = resonances(Workshop(folder))
    return section, folder, known[0]


@pytest.fixture(scope="module")
def branch(made: tuple[Section, Path, Ridge]) -> Ridge:
    return made[2]


@pytest.fixture(scope="module")
def section(made: tuple[Section, Path, Ridge]) -> Section:
    return made[0]


def chain(frequency: float = PEAK) -> ImpactChain:
    return Workshop(Path()).chain(frequency)


def test_item_writes_its_figure(made: tuple[Section, Path, Ridge]) -> None:
    section, folder, _ = made
    assert section.figures == ["resonances"]
    assert sorted(p.name for p in folder.iterdir()) == ["resonances.png", "resonances.svg"]


def test_settled_motions_have_the_energies_of_the_branch(branch: Ridge) -> None:
    for place in (3, len(branch.orbits) // 2, -4):
        orbit = branch.orbits[place]
        settled = orbit.system.attractor(transient=20_000, impacts=200).record
        error = energy_error(orbit)
        assert error < 1e-10
        assert abs(settled.energy.max() - branch.energies[place]) <= error + 1e-12


def test_contacts_and_flights_fill_the_period(branch: Ridge) -> None:
    for orbit, each in zip(branch.orbits, branch.measures, strict=True):
        assert each.flight + each.chatter + each.contact == pytest.approx(orbit.period, abs=1e-9)


def test_contacts_vanish_at_the_ends_alone(branch: Ridge) -> None:
    assert branch.contacts[[0, -1]] == pytest.approx(0.0, abs=1e-3)
    assert (branch.contacts[1:-1] > 0.0).all()


def test_chain_sticks_inside_the_ends_and_not_beyond(branch: Ridge) -> None:
    for border, inward in zip(branch.ends, (1.0, -1.0), strict=True):
        for side in (1.0, -1.0):
            system = chain(border.value + side * inward * 1e-6)
            start = system.impact_state(border.orbit.states[0])
            motion = system.attractor(transient=20_000, impacts=200, start=start)
            assert (len(motion.record.sticking) > 0) == (side > 0.0)


def test_motions_beyond_the_ends_do_not_stick(branch: Ridge) -> None:
    low, high = (border.value for border in branch.ends)
    assert len(branch.beside) == 6
    for motion in branch.beside:
        assert not low <= motion.frequency <= high
        assert motion.contacts == 0
        assert motion.label.iterates is not None


def test_largest_energy_is_where_orbits_say_within_its_error(branch: Ridge) -> None:
    at, error = branch.top
    found = {}
    for frequency in (at - 20.0 * error - 1e-5, at, at + 20.0 * error + 1e-5):
        record = chain(frequency).attractor(transient=20_000, impacts=200).record
        found[frequency] = float(record.energy.max())
    assert max(found, key=lambda frequency: found[frequency]) == at
    assert branch.energy_at(at) == pytest.approx(found[at], rel=1e-4)


def test_text_gives_the_located_ends(section: Section, branch: Ridge) -> None:
    for border in branch.ends:
        assert f"CB {border.value:.10f} ({border.error:.0e})" in section.text


def test_text_names_the_rule_that_comes_nearest(section: Section) -> None:
    assert "The rule that comes nearest is: bilinear." in section.text
    (cause,) = (found for found in section.findings if found.what == "cause of the resonances")
    # the one resonance that is made here
    assert cause.found.startswith("bilinear frequency times 1: ")


def test_table_of_rules_has_their_columns_and_all_chains(section: Section) -> None:
    lines = section.text.splitlines()
    (head,) = (line for line in lines if line.startswith("| chain |"))
    assert [cell.strip() for cell in head.strip("|").split("|")][-len(RULES) :] == list(RULES)
    begins = [line.split("|")[1].strip() for line in lines if line.startswith("| ")]
    assert {"the paper's", *OTHERS} <= set(begins)


def test_text_says_what_searches_found(section: Section) -> None:
    assert "None was found" in section.text
    assert "2 motions from random starts" in section.text


@pytest.mark.parametrize("n", [4, 10, 17])
def test_modes_are_those_of_uniform_chains(n: int) -> None:
    modes = modes_of(ImpactChain(masses=n, frequency=0.2))
    free = [2.0 * sin((2 * i - 1) * pi / (2 * (2 * n + 1))) for i in range(1, n + 1)]
    stuck = [2.0 * sin(i * pi / (2 * n)) for i in range(1, n)]
    assert modes.free == pytest.approx(np.array(free), rel=1e-12)
    assert modes.stuck == pytest.approx(np.array(stuck), rel=1e-12)
    assert modes.passage == pytest.approx(n, rel=1e-12)


def test_passage_takes_each_spring_with_its_mass() -> None:
    system = ImpactChain(masses=(1.0, 4.0, 9.0), springs=(4.0, 1.0, 0.25), frequency=0.2)
    assert modes_of(system).passage == pytest.approx(0.5 + 2.0 + 6.0, rel=1e-12)


def test_bilinear_period_is_half_of_each() -> None:
    modes = modes_of(chain())
    period = pi / modes.free[0] + pi / modes.stuck[0]
    assert 2.0 * pi / bilinear(modes) == pytest.approx(period, rel=1e-14)


def test_rules_agree_in_long_uniform_chains() -> None:
    modes = modes_of(ImpactChain(masses=60, frequency=0.2))
    # Three passages of N beside 2N + 1 and N.
    assert RULES["wave"](modes) / bilinear(modes) == pytest.approx(181.0 / 180.0, rel=1e-4)


def test_resonance_is_found_where_the_branch_has_it(branch: Ridge) -> None:
    found = causes.resonance("the same", chain(), 1)
    assert abs(found.frequency - branch.top[0]) <= found.step
    assert found.sticks
    assert spread([found], "bilinear")[1] < 0.01


def test_force_that_holds_a_single_mass_is_that_of_its_spring_dashpot_and_inertia() -> None:
    w, spring, damping = 0.7, 2.0, 0.3
    system = ImpactChain(masses=1, springs=spring, damping=damping, frequency=w)
    expected = abs(spring - w * w + 1j * w * damping * spring)
    assert holding_force(system, w) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_drive_is_the_integral_of_force_and_velocity(m: int) -> None:
    modes = modes_of(chain())
    k = m * bilinear(modes) / float(modes.stuck[0])
    s = (np.arange(100_000) + 0.5) * pi / 100_000
    integral = abs((np.sin(s) * np.exp(1j * k * s)).mean() * pi)
    assert drive(modes, m) == pytest.approx(m * integral, rel=1e-8)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_mismatch_is_that_of_a_reversed_table(m: int) -> None:
    modes = modes_of(chain())
    turn = m * bilinear(modes) * pi / modes.free[0]
    phases = np.linspace(0.0, 2.0 * pi, 1001)
    largest = abs(np.sin(phases + turn) + np.sin(phases)).max()
    assert mismatch(modes, m) == pytest.approx(largest, rel=1e-5)


def test_random_starts_are_the_same_again_and_off_the_table() -> None:
    system = chain()
    first, again = random_starts(system, 5), random_starts(system, 5)
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.position, other.position)
        assert one.position[-1] > system.amplitude


def test_impacts_that_the_paper_keeps_last_less_than_four_table_periods() -> None:
    seen = shown(chain(0.40816), 2)
    record = chain(0.40816).simulate(impacts=paper.TRANSIENT + paper.KEPT)
    span = (record.time[-1] - record.time[paper.TRANSIENT - 1]) * 0.40816 / (2.0 * pi)
    assert seen.kept == pytest.approx(span, rel=1e-12)
    assert seen.kept < 4.0


def test_contacts_of_a_sweep_are_those_of_its_motions() -> None:
    sweep = Workshop.swept(chain(0.2), np.array([0.2, 0.202]))
    again = chain(0.2).attractor(transient=paper.TRANSIENT, impacts=paper.KEPT)
    assert np.array_equal(contacts_of(sweep, 0), again.record.sticking)
