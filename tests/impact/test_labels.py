"""Labels of the motions that the paper and an independent computation found."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.core.no_motion import NoCrossing
from dynkit.labels.label import OrbitKind
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor
from dynkit.systems.impact.oscillators.chain import ImpactChain
from tests.impact.many_digits import state_error
from tests.reference.impact_chain import ReferenceChain

PAPER = {
    0.16: "P(7,1)",
    0.28: "P(2,1)",
    0.33: "P(5,2)",
    0.34: "P(5,2)",
    0.36: "P(74,32)",
    0.408: "P(inf,2)",
    0.40816: "P(inf,2)",
    0.46: "P(4,2)",
    0.55: "P(2,2)",
    0.64: "P(1,1)",
    0.67: "P(3,3)",
    0.79: "P(2,3)",
    0.87: "P(1,3)",
    1.2: "P(1,4)",
    1.31: "P(2,5)",
    1.336: "P(2,5)",
    1.346: "chaotic",
    1.5: "P(1,5)",
    1.75: "P(1,6)",
    1.916: "chaotic",
}
"""Labels by frequency, from the sweep of an independent computation."""


@pytest.mark.parametrize(("frequency", "label"), PAPER.items())
def test_motions_have_the_labels_of_the_sweep(frequency: float, label: str) -> None:
    assert str(ImpactChain(frequency=frequency).attractor().label) == label


@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
def test_labels_say_their_tolerance_and_what_they_looked_at(frequency: float) -> None:
    label = ImpactChain(frequency=frequency).attractor().label
    assert label.tolerance == 1e-6
    assert label.simulated >= 100
    assert label.recurrence >= 0.0


@pytest.mark.parametrize("frequency", [0.28, 0.64, 0.87, 1.2, 1.5])
def test_periodic_motions_recur_to_the_tolerance(frequency: float) -> None:
    label = ImpactChain(frequency=frequency).attractor().label
    assert label.recurrence <= label.tolerance


@pytest.mark.parametrize("frequency", [0.36, 0.408, 1.346])
def test_a_budget_that_is_too_small_leaves_the_label_open(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency).attractor(transient=100, impacts=100)
    label = attractor.label_within(200)
    assert label.kind is OrbitKind.UNSETTLED
    assert str(label) == "unsettled"
    assert label.simulated <= 200


def test_chaos_is_told_however_many_impacts_were_kept() -> None:
    attractor = ImpactChain(frequency=1.346).attractor(transient=2000, impacts=20_000)
    assert str(attractor.label) == "chaotic"


def test_a_label_keeps_to_its_budget() -> None:
    attractor = ImpactChain(frequency=0.35).attractor()
    assert attractor.label_within(1000).simulated <= 1000


def test_chaos_at_0_35_gives_way_to_a_periodic_motion() -> None:
    attractor = ImpactChain(frequency=0.35).attractor(transient=40_000)
    assert str(attractor.label) == "P(39,15)"


def attractor_from(seed: int) -> ImpactAttractor:
    """What the paper's chain at 0.87 does after a random start."""
    chain = ImpactChain(frequency=0.87)
    random = np.random.default_rng(seed)
    position = 0.3 * random.normal(size=10)
    position[-1] = 0.5
    start = chain.state(position, 0.1 * random.normal(size=10), phase=random.uniform(0.0, 6.0))
    return chain.attractor(transient=2000, start=start)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_the_paper_motion_at_0_87_is_reached_from_most_starts(seed: int) -> None:
    assert str(attractor_from(seed).label) == "P(1,3)"


def test_another_motion_at_0_87_recurs_to_50_digits() -> None:
    attractor = attractor_from(2)
    assert str(attractor.label) == "P(2,4)"
    state = attractor.states[-1]
    history = ReferenceChain(frequency=0.87).simulate(
        2,
        [*state[:9].tolist(), 0.0],
        [*state[9:18].tolist(), 0.0],
        phase=float(state[-1]),
        relative_velocity=float(state[-2]),
    )
    assert state_error(state, history.impacts[-1]) < 1e-14


def test_a_focus_of_releases_is_labelled_although_no_straight_fit_describes_its_decay() -> None:
    chain = ImpactChain(frequency=0.2, restitution=0.6818)
    label = chain.attractor(transient=900, keep=100).label
    assert str(label) == "P(inf,1)"
    assert label.simulated <= 6400
    record = chain.attractor(transient=label.simulated, keep=60).record
    ends = record.sticking[:, 1] * chain.frequency / (2.0 * np.pi)
    assert np.diff(ends) == pytest.approx(1.0, abs=label.tolerance)


DOUBLING = ImpactChain(
    masses=3, restitution=0.4093844585374893, damping=0.01, frequency=2.2364551875384175
)
"""A chain whose P(2,3) is about to double its period: the multiplier is -0.9993963."""


def test_a_motion_that_alternates_has_no_doubled_period() -> None:
    label = DOUBLING.attractor(transient=700, impacts=100).label
    assert str(label) == "P(2,3)"
    exact = DOUBLING.attractor(transient=60_000, impacts=100).label
    assert abs(label.multiplier - exact.multiplier) <= label.multiplier_error


@pytest.mark.parametrize(
    ("masses", "restitution", "damping", "frequency", "transient", "label"),
    [
        (3, 0.5012110617646246, 0.1, 1.7214261864871083, 50, "P(1,2)"),
        (3, 0.517220097705934, 0.2, 1.2521833842433219, 0, "P(1,1)"),
        (2, 0.26799680400937964, 0.01, 1.9315317530157443, 0, "P(9,2)"),
    ],
)
def test_rounding_does_not_choose_the_period_of_a_motion_that_has_just_settled(
    *, masses: int, restitution: float, damping: float, frequency: float, transient: int, label: str
) -> None:
    chain = ImpactChain(
        masses=masses, restitution=restitution, damping=damping, frequency=frequency
    )
    impacts = 60 if transient else 100
    assert str(chain.attractor(transient=transient, impacts=impacts).label) == label
    assert str(chain.attractor(transient=8000, impacts=impacts).label) == label


def test_few_impacts_of_a_motion_that_alternates_show_no_doubled_period() -> None:
    chain = ImpactChain(
        masses=3, restitution=0.7927732168673518, damping=0.02, frequency=0.8339976561375324
    )
    assert str(chain.attractor(transient=100, impacts=30).label) == "P(1,1)"


@pytest.mark.parametrize(
    ("frequency", "transient"), [(2.2363915389206657, 100), (2.236384459779958, 100)]
)
def test_an_orbit_of_twice_the_period_is_not_called_unstable(
    frequency: float, transient: int
) -> None:
    """The motion settles on a stable P(4,6); its states are between this orbit and P(2,3)."""
    chain = DOUBLING.replace(frequency=frequency)
    assert chain.attractor(transient=transient, impacts=100).label.stable is not False
    settled = chain.attractor(transient=60_000, impacts=100).label
    assert (str(settled), settled.stable) == ("P(4,6)", True)


def test_a_motion_that_does_not_return_has_no_multiplier(monkeypatch: pytest.MonkeyPatch) -> None:
    table = HardStop(1, amplitude=0.1, restitution=0.8)
    stops = table, HardStop(1, offset=0.6, restitution=0.6, side="below")
    machine = ImpactChain(masses=2, frequency=0.9, elements=stops)
    assert machine._mapped
    assert np.isfinite(machine.attractor().label.multiplier)

    def ends(*_: object) -> None:
        raise NoCrossing("there is no next impact")

    monkeypatch.setattr(type(machine), "_followed", ends)
    label = machine.attractor().label
    assert label.kind is OrbitKind.PERIODIC
    assert np.isnan(label.multiplier)


def test_sticking_motions_count_table_periods_and_no_impacts() -> None:
    label = ImpactChain(frequency=0.408).attractor().label
    assert label.kind is OrbitKind.STICKING
    assert label.iterates is None
    assert label.periods == 2


@pytest.mark.parametrize("offset", [-3.0, 0.5])
def test_a_motion_that_ends_has_no_impacts(offset: float) -> None:
    chain = ImpactChain(masses=3, offset=offset, frequency=0.1)
    start = chain.state(np.array([0.5, 1.0, 1.5]))
    label = chain.attractor(start=start).label
    assert label.kind is OrbitKind.NO_IMPACTS


def test_dead_impacts_are_labelled_by_their_periods() -> None:
    # Restitution 0 in the sticking range: contact in every period, no chatter.
    label = ImpactChain(frequency=0.16, restitution=0.0).attractor().label
    assert label.kind is OrbitKind.STICKING
    assert label.periods == 1


def test_a_motion_that_oscillates_while_it_settles_gets_the_orbit_that_it_settles_on() -> None:
    """With little damping, the distances of releases fall and rise by turns."""
    motion = ImpactChain(frequency=0.408, damping=0.01).attractor(transient=30_000, impacts=200)
    assert str(motion.label) == "P(inf,2)"
    exact = abs(motion.periodic_orbit().multipliers[0])
    assert abs(motion.label.multiplier - exact) <= motion.label.multiplier_error < 1e-4


def test_the_error_of_a_multiplier_holds_while_the_motion_spirals_into_its_orbit() -> None:
    chain = ImpactChain(
        masses=2, restitution=0.21374084735860338, damping=0.005, frequency=1.253653462395794
    )
    label = chain.attractor(transient=50, impacts=100).label
    exact = chain.attractor(transient=8000, impacts=100).label
    assert str(label) == str(exact) == "P(1,1)"
    assert abs(label.multiplier - exact.multiplier) <= label.multiplier_error < 1e-6


@pytest.mark.parametrize("tolerance", [1e-10, 1e-12, 1e-16, 1e-20])
def test_labels_do_not_depend_on_the_cut_of_chatter(tolerance: float) -> None:
    chain = ImpactChain(frequency=0.408, chatter_tolerance=tolerance)
    assert str(chain.attractor().label) == "P(inf,2)"


# --- transient chaos -----------------------------------------------------------------------------


@pytest.mark.parametrize("transient", [700, 1500])
def test_chaos_at_0_35_is_transient(transient: int) -> None:
    # Nine runs of an independent computation settled after 8,000 to 31,000 impacts. How long chaos
    # lasts from one start depends on last digits: the first start is taken whose chaos outlasts the
    # label, and which has settled within the budget (one took 128,000 impacts).
    chain = ImpactChain(frequency=0.35)
    rest = chain.state()
    starts = [rest, *(chain.state(rest.position + 0.01 * i, rest.velocity) for i in range(20))]
    motions = (chain.attractor(start=start, transient=transient) for start in starts)
    labels = (motion.settled_label() for motion in motions if str(motion.label) == "chaotic")
    undecided = OrbitKind.CHAOTIC, OrbitKind.UNSETTLED
    label = next(label for label in labels if label.kind not in undecided)
    assert str(label) == "P(39,15) after transient chaos"
    assert 800 <= label.transient_chaos < label.simulated <= 100_000


@pytest.mark.parametrize("frequency", [0.34, 0.408, 0.87])
def test_what_was_not_chaotic_settles_on_its_label(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency).attractor()
    assert attractor.settled_label() == attractor.label
    assert attractor.settled_label().transient_chaos == 0


def test_chaos_that_lasts_stays_chaotic() -> None:
    attractor = ImpactChain(frequency=1.346).attractor()
    label = attractor.settled_label(budget=20_000)
    assert str(label) == "chaotic"
    assert label.transient_chaos == 0
    assert 10_000 < label.simulated <= 20_000


@pytest.mark.parametrize("length", [1e-3, 1e-6, 1e-9, 1e6])
def test_labels_of_motions_that_stick_do_not_depend_on_the_unit_of_length(length: float) -> None:
    chain = ImpactChain(
        masses=(1.0, 1.7, 0.6),
        springs=(1.0, 0.8, 1.3),
        damping=(0.1, 0.05, 0.12),
        frequency=0.3,
        restitution=0.6,
        amplitude=0.1 * length,
        chatter_tolerance=1e-12 * length,
    )
    start = chain.state(length * np.array([0.3, 0.4, 0.5]), length * np.array([0.1, 0.2, 0.1]), 0.7)
    assert str(chain.attractor(start=start).label) == "P(inf,1)"
