"""The words of the reproduction follow from what it finds: other findings, other words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dynkit import OrbitKind
from dynkit.analysis import ChatterRatios
from dynkit.core.validation import Array
from tutorials.cusumano_bai_1993 import chatter, differences, orbits, paper, resonances
from tutorials.cusumano_bai_1993.measures.table_1 import apart
from tutorials.cusumano_bai_1993.measures.transient import VERY_LONG, which_chaos
from tutorials.cusumano_bai_1993.resonances.causes import RULES, Modes, Resonance
from tutorials.cusumano_bai_1993.resonances.search import Shown, about_doubling, what_was_seen
from tutorials.cusumano_bai_1993.section import LOOKED_INTO
from tutorials.cusumano_bai_1993.settling import Settling

LIMIT = 0.85

# --- figure 3 -------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [25, 60, None])
def test_rounded_flights_go_astray_where_they_do(first: int | None) -> None:
    ratios = np.full(100, LIMIT)
    if first is not None:
        ratios[first - 1 :] = np.nan
    expected = f"go astray by more than 0.01 at bounce {first}"
    if first is None:
        expected = "stay within 0.01 of it over 100 bounces"
    assert chatter.astray(ratios, LIMIT) == expected


def flights(power: float) -> ChatterRatios:
    """Flights whose ratios approach the limit as a power of their length."""
    lengths = [1.0]
    for _ in range(150):
        lengths.append(lengths[-1] * LIMIT * (1.0 - 0.1 * lengths[-1] ** power))
    return ChatterRatios(np.array(lengths))


@pytest.mark.parametrize(("power", "no_error"), [(1.0, True), (0.5, False), (0.7, False)])
def test_what_is_left_is_the_approach_only_where_it_falls_as_the_flights(
    power: float, *, no_error: bool
) -> None:
    words = chatter.approach(flights(power), LIMIT, 1e-13)
    assert f"falls as the power {power:.2f} of" in words
    assert ("no error" in words) == no_error


def test_ratios_that_are_soon_at_the_limit_approach_nothing() -> None:
    words = chatter.approach(flights(1.0), LIMIT, 0.05)
    assert words.startswith("The ratio is within 5e-02 of it from bounce ")


# --- figures 7 to 12 ------------------------------------------------------------------------------

UNSETTLED = paper.SHOWN[9]


def early(*velocities: float) -> Array:
    """The tip at phase zero in a motion of two table periods: every other state is low."""
    states = np.ones((2 * len(velocities), 2))
    states[1::2] = [[-1.0, velocity] for velocity in velocities]
    return states


@pytest.mark.parametrize(
    ("velocities", "said", "unsaid"),
    [
        ((0.1, 0.3, 0.2, 0.25), "The first 4 of them rise and fall in turn", "are the same"),
        ((0.1, 0.3, 0.2, 0.15), "The first 3 of them rise and fall in turn", "are the same"),
        ((0.1, 0.2, 0.3, 0.35), "The motion has not settled then.", "in turn"),
        ((0.1, 0.1, 0.1, 0.1), "They are the same: the motion has settled then.", "in turn"),
    ],
)
def test_early_velocities_alternate_where_they_do(
    velocities: tuple[float, ...], said: str, unsaid: str
) -> None:
    words = orbits.about_early(UNSETTLED, early(*velocities), 2)
    assert said in words
    assert unsaid not in words
    assert f"the velocities {', '.join(f'{each:.4f}' for each in velocities)}." in words


@pytest.mark.parametrize(
    ("theirs", "multiples"), [(2, None), (4, "0.40816/4"), (3, "0.40816/6"), (None, None)]
)
def test_lines_of_the_papers_reading_are_looked_for_where_there_are_others(
    theirs: int | None, multiples: str | None
) -> None:
    w = UNSETTLED.frequency
    spectrum: Any = SimpleNamespace(frequencies=np.linspace(0.0, 6.0, 4001), density=np.ones(4001))
    lines: Any = SimpleNamespace(
        frequency=w / 2, power=np.ones(8), variance=8.0, error=1e-9, coefficients=np.ones(8),
        frequencies=w / 2 * np.arange(1.0, 9.0),
    )  # fmt: skip
    label: Any = SimpleNamespace(periods=2, harmonics=6)
    found = orbits._lines(UNSETTLED._replace(periods=theirs), label, spectrum, lines)
    assert ("the paper's reading" in found.text) == (multiples is not None)
    assert multiples is None or f"at multiples of {multiples}:" in found.text


# --- Table 1 --------------------------------------------------------------------------------------


def runs(*settled: int | None) -> Any:
    return [SimpleNamespace(settled=each) for each in settled]


def test_chaos_ends_only_where_runs_settle() -> None:
    assert which_chaos(runs(3000, None)) == "the chaos before it ends, as it does in 1 of 2 runs"
    assert which_chaos(runs(None, None)) == "chaos that goes on to the end of all 2 runs"


def line(row: paper.Row, name: str, modes: int, *, ends: bool = False) -> Any:
    motion = SimpleNamespace(
        name=name,
        label=SimpleNamespace(iterates=None if name.startswith("chaotic") else 5),
        pod=SimpleNamespace(cumulative=np.full(10, 0.9), cumulative_errors=np.full(10, 1e-3)),
    )
    return SimpleNamespace(row=row, motion=motion, modes=modes, ends=ends)


def rows(frequency: float) -> paper.Row:
    row = next(row for row in paper.TABLE_1 if row.frequency == frequency)
    return row._replace(dimension=None)


def test_what_agrees_with_the_paper_is_not_listed() -> None:
    lines = [line(rows(0.34), "P(5,2)", 3), line(rows(0.36), "P(74,32)", 3)]
    assert apart(lines) == []


def test_another_orbit_and_another_number_of_modes_are_listed() -> None:
    found = apart([line(rows(0.34), "P(10,4)", 4), line(rows(0.36), "P(37,16)", 3)])
    assert found == [
        "0.34, damping 0.1: the paper P(5,2), found P(10,4).",
        "0.34, damping 0.1: N is 4, not 3; 3 modes hold 90.00 % ± 0.1 %.",
        f'0.36, damping 0.1: the paper P(.,32), found P(37,16) (see "{LOOKED_INTO}").',
    ]


@pytest.mark.parametrize(("after", "count"), [("P(39,15)", 1), ("chaotic", 0)])
def test_chaos_is_listed_as_ending_where_it_does(after: str, count: int) -> None:
    row = rows(paper.CHAOS)
    begun = line(row, "chaotic for 1 to 2 impacts", 3, ends=True)
    ended = line(row._replace(orbit="-", modes=None), after, 3)
    found = apart([begun, ended])
    assert len(found) == count
    assert all(f"the paper chaotic, found {after}." in each for each in found)


# --- statements that are looked into --------------------------------------------------------------


def test_statements_that_hold_are_said_to_hold() -> None:
    assert differences.verdict(5, []) == (
        "All 5 statements of the paper that are looked into here hold."
    )
    assert differences.verdict(5, ["a"]).endswith("1 does not hold: a.")
    assert differences.verdict(5, ["a", "b"]).endswith("2 do not hold: a, b.")


@pytest.mark.parametrize(
    ("left", "holds", "said"),
    [
        (0.05, False, "is not settled yet, which may be why the paper reads another motion:"),
        (0.05, True, "is not settled yet:"),
        (1e-5, False, "is settled, as far as a figure shows it:"),
    ],
)
def test_impacts_of_the_paper_are_settled_where_they_are(
    left: float, said: str, *, holds: bool
) -> None:
    found = Settling(
        2, 0.87, 40, 25.0, 2.0, np.arange(0.0, 4000.0), np.full(4000, left), np.arange(5000.0)
    )
    words = differences.about_settling(found, holds=holds)
    assert said in words
    assert "2 table periods multiply the distance to the periodic motion by a factor 0.870" in words


def test_chaos_is_a_transient_only_where_all_runs_settle() -> None:
    assert "the paper shows is a long transient." in differences.about_chaos(2, [5, 9], "P(1,1)")
    some = differences.about_chaos(3, [5, 9], "P(1,1)")
    assert "ends in these 2." in some
    assert "is a long transient" not in some
    none = differences.about_chaos(3, [], "the same")
    assert none == f"Of 3 runs of {VERY_LONG} impacts, besides the first 700, none settled."


def test_kinds_of_labels_decide_whether_chaos_is_chaos() -> None:
    assert paper.agrees("chaotic", str(OrbitKind.CHAOTIC.value))
    assert not paper.agrees("P(inf,4)", "P(inf,2)")


# --- resonances -----------------------------------------------------------------------------------


def beside(*impacts: int | None, contacts: int = 0) -> Any:
    return [
        SimpleNamespace(contacts=contacts, label=SimpleNamespace(iterates=each)) for each in impacts
    ]


def test_impacts_are_fewer_farther_from_an_end_only_where_they_are() -> None:
    fewer = "fewer impacts the further"
    assert fewer in resonances.about_beside([beside(40, 30, 20, 40, 30, 25)])
    assert fewer not in resonances.about_beside([beside(40, 30, 20, 40, 45, 25)])
    assert fewer not in resonances.about_beside([beside(40, 30, None, 40, 30, 25)])
    assert resonances.about_beside([beside(4, 3, 2, 4, 3, 2, contacts=1)]) == "6 of 6 stick."


def test_energies_apart_are_of_motions_that_settle_only_where_they_do() -> None:
    assert (
        resonances.about_unsettled(9, 0, 0) == "They differ by more than 1 % at 0 of 9 frequencies."
    )
    assert "at 4 of 9 frequencies, at 1 of which" in resonances.about_unsettled(9, 4, 1)


FREE, STUCK = np.array([0.15, 0.45]), np.array([0.31, 0.62])
STRING = Modes(FREE, STUCK, 10.0)
UNLIKE = Modes(np.array([0.15, 0.30]), np.array([0.31, 0.80]), 14.0)


def case(name: str, modes: Modes, off: float, *, sticks: bool = True) -> Resonance:
    """A resonance that is so far above the bilinear frequency."""
    return Resonance(name, 1, modes, RULES["bilinear"](modes) * (1.0 + off), 0.1, 0.001, sticks)


def test_distances_from_natural_frequencies_are_those_of_the_nearest() -> None:
    words = resonances.about_nearest(STRING, [0.15, 0.403])
    assert words == "The nearest of them are 0 % and 12 % from the resonances."


def test_a_reason_is_given_only_for_a_rule_that_holds_where_it_should() -> None:
    reason = "Why it should need these ratios"
    near, far = [case("one", STRING, 0.01)], [case("other", UNLIKE, 0.1)]
    words = resonances.verdict([*near, *far], "bilinear")
    assert reason in words
    assert "within 1.0 % in the 1 cases" in words
    assert "of 3 and 2 (one). It holds within 10.0 % in the other 1." in words
    assert reason not in resonances.verdict([*near, *far], "wave")
    assert reason not in resonances.verdict(near, "bilinear")
    other = [case("one", STRING, 0.1), case("other", UNLIKE, 0.01)]
    words = resonances.verdict(other, "bilinear")
    assert reason not in words
    assert "It is furthest off for one." in words


def test_impacts_are_soft_only_where_they_are() -> None:
    assert resonances.softness([0.1, 0.2], 0.5) == "softer than elsewhere"
    assert resonances.softness([0.1, 0.6], 0.5) == "softer than elsewhere at some only"
    assert resonances.softness([0.6, 0.6], 0.5) == "no softer than elsewhere"


def test_work_and_heights_of_a_third_resonance_are_compared() -> None:
    assert "it is not what is missing" in resonances.about_drives([1.0, 2.0, 1.5])
    assert "it is least for the last" in resonances.about_drives([1.0, 2.0, 0.5])
    assert "there is no third one" in resonances.about_elsewhere(0.1, [0.2, 0.3])
    assert "there is a third one" in resonances.about_elsewhere(0.25, [0.2, 0.3])


def test_chains_without_sticking_are_named() -> None:
    none = resonances._left_open([case("a", STRING, 0.0)])
    assert "without sticking" not in none
    some = resonances._left_open([case("a", STRING, 0.0), case("b", STRING, 0.0, sticks=False)])
    assert some.endswith("without sticking (b).")


def seen(kept: float, better: int) -> Shown:
    two = np.full(5, 0.1)
    four = two + np.where(np.arange(5) < better, -0.01, 0.01)
    return Shown(50.0, kept, two, four)


def test_a_section_is_no_sign_of_a_period_only_where_states_do_not_return() -> None:
    words = what_was_seen(seen(3.5, 2), 0.9 + 0.1j, "P(inf,2)", 2)
    assert "that it keeps 3.5, less than one period of 4." in words
    assert "and 2 of them return better after 4 than after 2." in words
    assert "no sign of that period" in words
    words = what_was_seen(seen(6.5, 5), 0.9 + 0.1j, "P(inf,2)", 2)
    assert "less than one period" not in words
    assert "no sign of that period" not in words


def test_multipliers_beyond_minus_one_are_counted() -> None:
    assert about_doubling([-0.9, -0.2]).startswith("None comes to -1")
    assert about_doubling([-0.9, -1.2]).startswith("1 of these motions")
