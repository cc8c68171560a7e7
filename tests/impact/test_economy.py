"""What a scene does not need is not there: terms, bases, numbers, imports, all counted."""

from __future__ import annotations

import pickle
import subprocess
import sys
import tracemalloc
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynkit import parameter_map, sweep
from dynkit.core.validation import Array
from dynkit.exponential import propagators
from dynkit.exponential.propagators import padded
from dynkit.systems.impact.elements.jenkins import Jenkins
from dynkit.systems.impact.elements.stops import HardStop, SoftStop
from dynkit.systems.impact.modes import structure
from dynkit.systems.impact.modes.bases import Basis, CoupledModes, NormalModes, row_by_row
from dynkit.systems.impact.modes.steady_response import Forced
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation import runs
from dynkit.systems.impact.simulation.automaton import Automaton
from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
from dynkit.systems.impact.simulation.runs import Course, course_from
from dynkit.systems.impact.simulation.trajectory import Ending, Impacts
from dynkit.systems.impact.variational import tangents
from dynkit.systems.structure.lagrangian import shared_derivation
from tests.reference.random_machines import random_machine


def terms(system: ImpactOscillator) -> int:
    """Terms of the gap that are not zero."""
    return int(np.any(system._gaps[0].rows[:2] != 0.0, axis=0).sum())


def star(arms: int) -> MatrixOscillator:
    """A mass above the table with equal arms tied to it: all but two modes are at rest there."""
    n = arms + 1
    stiffness = np.diag([1.0 + arms] + [1.5] * arms)
    stiffness[0, 1:] = stiffness[1:, 0] = -1.0
    return MatrixOscillator(
        M=np.eye(n), C=0.1 * stiffness, K=stiffness, contact=0, frequency=0.9, amplitude=0.3
    )


def test_a_table_at_rest_is_no_term() -> None:
    chain = ImpactChain(masses=8, frequency=0.9)
    still = chain.replace(amplitude=0.0)
    assert (terms(chain), terms(still)) == (9, 8)
    assert still._free.layout.slots == 8
    assert chain._free.layout.slots == padded(9) == 16


def test_a_table_at_rest_turns_under_harmonic_forces_alone() -> None:
    chain = ImpactChain(masses=8, frequency=0.9, amplitude=0.0, harmonic_forces=(0.0,) * 7 + (1.0,))
    assert terms(chain) == 9


def test_what_no_weight_drives_has_no_constant_term() -> None:
    # The weights of a structure that is held only move its rest.
    chain = ImpactChain(masses=8, frequency=0.9, amplitude=0.0, constant_forces=(-0.1,) * 8)
    assert chain._free.layout.slots == 8
    assert not len(chain._gaps[0].links)


def test_without_contact_there_is_no_basis_for_it() -> None:
    chain = ImpactChain(masses=4, springs=(1.0, 1.0, 1.0, 1.25), frequency=1.31)
    record = chain.simulate(impacts=20)
    assert not len(record.sticking)
    assert len(chain._automaton.modes) == 1
    assert "holding" not in {name for name, *_ in vars(chain._structure)["_kept"]}


@pytest.mark.parametrize(
    "system",
    [
        ImpactChain(masses=20, frequency=0.5),
        ImpactChain(masses=20, frequency=0.5, play=3.0, damping=tuple(np.linspace(0.1, 0.3, 20))),
    ],
)
def test_contact_at_another_frequency_takes_no_modes_anew(
    system: ImpactOscillator, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make_ready(oscillator: ImpactOscillator) -> None:
        automaton = oscillator._automaton
        for number in [automaton.guard(0, k) for k in range(len(oscillator._stops))]:
            automaton.enter(number)
            contact = automaton.guards[number]
            assert contact.change.any()
            assert automaton.guards[contact.partner].change.any()

    make_ready(system)
    rows: list[int] = []
    for basis in (NormalModes, CoupledModes):

        def counted(self: Basis, x: Array, v: Array, plain: Any = basis.coordinates) -> Array:
            rows.append(int(np.prod(x.shape[:-1])))
            return np.asarray(plain(self, x, v))

        monkeypatch.setattr(basis, "coordinates", counted)
    make_ready(system.replace(frequency=0.7))
    assert max(rows) <= 3  # sine and cosine of the table, and the rest


def test_all_points_of_a_plane_look_for_their_energies_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[ImpactOscillator] = []

    def counted(system: Any, plain: Any = shared_derivation) -> Any:
        looked.append(system)
        return plain(system)

    monkeypatch.setattr(f"{DrivenStructure.__module__}.shared_derivation", counted)
    values = {"frequency": [0.86, 0.87, 0.88], "restitution": [0.8, 0.85, 0.9]}
    counts = []
    for few in (1, 3):
        looked.clear()
        axes = {name: axis[:few] for name, axis in values.items()}
        parameter_map(ImpactChain(masses=2, frequency=0.8), axes, keep=20, progress=False)
        counts.append(len(looked))
    # the check of arguments looks once for each value of a parameter
    assert counts[1] - counts[0] == 2 * 2


@pytest.mark.parametrize("size", [1, 2, 10, 37])
@pytest.mark.parametrize("shape", [(), (1,), (15,), (16,), (33,), (5, 7)])
def test_products_row_by_row_are_sums_in_order(size: int, shape: tuple[int, ...]) -> None:
    random = np.random.default_rng(size)
    matrix = random.normal(size=(size, size + 2)) * 10.0 ** random.integers(-9, 9, (size, size + 2))
    rows = random.normal(size=(*shape, 2, size + 2))[..., 0, :]
    rows[..., 0] = -0.0
    sums = np.add.accumulate(rows[..., None, :] * matrix, axis=-1)[..., -1]
    assert row_by_row(rows, matrix).tobytes() == np.ascontiguousarray(sums).tobytes()


@pytest.mark.parametrize("damping", [0.1, (0.1, 0.2, 0.05, 0.1)])
def test_a_sweep_in_frequency_builds_the_structure_once(
    damping: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: Counter[str] = Counter()

    def counted(owner: Any, name: str) -> None:
        plain = getattr(owner, name)

        def call(*arguments: Any, **options: Any) -> Any:
            calls[name] += 1
            return plain(*arguments, **options)

        monkeypatch.setattr(owner, name, call)

    counted(structure, "Structure")
    counted(structure, "basis_of")
    counted(propagators, "steps")
    counted(Forced, "_arranged")
    springs = (1.0, 1.0, 1.0, 1.125)
    chain = ImpactChain(masses=4, springs=springs, damping=damping, restitution=0.3, frequency=0.4)
    found = sweep(chain, "frequency", np.linspace(0.4, 0.6, 21), transient=50, progress=False)
    assert found.cost.counts["contacts"] > 0
    # free flight and contact, each a structure, and the free motion that labels ask for
    assert calls == {"Structure": 2, "basis_of": 2, "steps": 3, "_arranged": 3}


@pytest.mark.parametrize(
    "machine",
    [
        ImpactChain(masses=4, frequency=0.4),
        PlayOscillator(frequency=1.38, play=1.0, spring=1.0, damping=0.1, force=1.0, amplitude=0.0),
    ],
)
def test_a_sweep_in_restitution_builds_each_mode_once(
    machine: ImpactOscillator, monkeypatch: pytest.MonkeyPatch
) -> None:
    built, plain = [0], Automaton._build

    def counted(*arguments: Any) -> None:
        built[0] += 1
        plain(*arguments)

    monkeypatch.setattr(Automaton, "_build", counted)
    values = np.linspace(0.0, 0.6, 13)
    given: dict[str, Any] = {"transient": 50, "keep": 60}
    machine._structure.automata.clear()
    found = sweep(machine, "restitution", values, follow=False, progress=False, **given)
    assert found.cost.counts["contacts"] > 0
    assert built[0] <= 1 + len(machine._stops)  # free flight, and contact with each stop
    for k, value in enumerate(values):
        machine._structure.automata.clear()
        alone = machine.replace(restitution=value).attractor(**given)
        kept = found.observable("relative_velocity")[k, : found.counts[k]]
        assert np.array_equal(kept, alone.record.relative_velocity)  # the same bits


@pytest.mark.parametrize("arms", [3, 20])
def test_modes_at_rest_where_contact_is_are_not_searched(arms: int) -> None:
    system = star(arms)
    layout = system._free.layout
    assert terms(system) == 3  # two modes and the table
    assert layout.seen == 8
    assert layout.slots == 8 + padded(arms - 1)


def test_modes_that_are_not_searched_move_all_the_same() -> None:
    system = star(3)
    arms = np.array([0.3, -0.1, -0.2])  # their mean is zero: nothing pulls at the mass
    start = system.state([0.5, *arms])
    record = system.simulate(impacts=10, start=start)
    rate, damping = np.sqrt(1.5), 0.1 * 1.5
    turn = np.sqrt(rate**2 - 0.25 * damping**2)
    decayed = np.exp(-0.5 * damping * record.time)
    decayed *= np.cos(turn * record.time) + 0.5 * damping / turn * np.sin(turn * record.time)
    apart = record.position[:, 1:] - record.position[:, 1:].mean(axis=1, keepdims=True)
    assert apart == pytest.approx(np.outer(decayed, arms), abs=1e-14)


def test_a_transient_is_not_recorded() -> None:
    chain = ImpactChain(masses=2, frequency=0.35)
    chain.simulate(impacts=10)
    tracemalloc.start()
    attractor = chain.attractor(transient=100_000, impacts=10)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert attractor.record.ending is Ending.COUNT_REACHED
    kept = attractor.record._run.log
    slots = attractor.system._free.layout.slots
    arrays = (kept.time, kept.speed, kept.guard, kept.states, kept.turn)
    assert sum(array.nbytes for array in arrays) == 10 * (2 * slots + 3) * 8
    assert peak < 200_000  # a record of the transient would take 6.4 million bytes


def test_positions_and_energies_wait_until_they_are_asked_for() -> None:
    record = ImpactChain(masses=2, frequency=0.9).simulate(impacts=10)
    assert not {"position", "velocity", "energy", "error"} & set(vars(record))


def a_body_that_comes_to_rest_on_the_lower_stop() -> ImpactRecord:
    """Nothing holds the body; where it rests, rounding decides whether it ever leaves again."""
    random = np.random.default_rng(25)
    links, mass = random.normal(size=(3, 2)), random.uniform(0.5, 4.0, 3)
    system = MatrixOscillator(
        M=np.diag(mass),
        C=0.1 * np.diag(mass),
        K=links @ links.T * 0.05,
        frequency=1.0,
        restitution=0.0,
        amplitude=0.0,
        side="below",
        play=2.5,
    )
    place, speed = random.uniform(-1.0, 1.0, (2, 3))
    place[-1] = -1.0
    return system.simulate(impacts=30, start=system.state(place, speed))


def test_twins_search_for_no_longer_than_the_run_whose_error_they_give(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record = a_body_that_comes_to_rest_on_the_lower_stop()
    twins: list[Course] = []

    def counted(*given: Any, **choices: Any) -> Course:
        twins.append(Course(*given, **choices))
        return twins[-1]

    monkeypatch.setattr("dynkit.systems.impact.records.record.course_from", counted)
    assert len(record.error) == len(record) > 0
    assert len(twins) == 3
    # a search to its own end would take a million cells
    assert max(twin.cells for twin in twins) < 200_000


def test_an_error_computes_the_states_of_the_run_once_and_those_of_each_twin_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computed: list[int] = []
    plain: Any = vars(ImpactRecord)["states"]

    def counted(record: ImpactRecord) -> Array:
        computed.append(len(record))
        return np.asarray(plain.fget(record))

    record = ImpactChain(masses=2, frequency=0.9).simulate(impacts=50)
    monkeypatch.setattr(ImpactRecord, "states", property(counted))
    assert len(record.error) == 50
    assert computed == [50] * 4


ALONE = ImpactChain(masses=2, frequency=0.9)


@pytest.mark.parametrize(
    "system",
    [ALONE, PlayOscillator(play=0.7, amplitude=0.0, frequency=1.3, force=1.0, restitution=0.8)],
    ids=["a stop alone", "several stops"],
)
def test_twins_run_in_the_machine_code_of_the_run_whose_error_they_give(system: Any) -> None:
    from dynkit.systems.impact.simulation import change_kernels, loop_kernels

    kernels: list[Any] = [loop_kernels.run, change_kernels.change]
    record = system.simulate(impacts=200)
    known = [list(kernel.signatures) for kernel in kernels]
    assert record.error[0] > 0.0
    assert [kernel.signatures for kernel in kernels] == known


def between_two_stops() -> ImpactChain:
    """Two masses, the last of which hits two stops in turn."""
    low = HardStop(1, offset=-0.3, restitution=0.7)
    high = HardStop(1, offset=0.3, side="below", restitution=0.7)
    return ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0.0, 0.5], elements=[low, high])


def test_the_stop_that_is_hit_next_is_searched_first() -> None:
    system = between_two_stops()
    record = system.simulate(impacts=1000, start=system.simulate(impacts=200).final)
    assert np.all(record.element[1:] != record.element[:-1])
    # The stop that was left, searched to its own next impact, would make it 14 cells.
    assert record.cost.counts["cells"] < 9 * len(record)


SLIDER = Jenkins(0, stiffness=1.0, force=0.2)
TWINS = ImpactChain(masses=1, frequency=0.4, harmonic_forces=[1.0], elements=[SLIDER, SLIDER])


@pytest.mark.parametrize("number", [None, 2, 4, 9, 17, 62, 87])
def test_the_order_in_which_guards_are_searched_has_no_effect(number: int | None) -> None:
    from dynkit.systems.impact.simulation.clock_kernels import SWITCHES
    from dynkit.systems.impact.simulation.loop_kernels import MOST_KNOWN, NEXT

    # Two equal sliders slip at the same moment, to the last bit.
    system, start = (TWINS, TWINS.state([0.0], [0.0])) if number is None else random_machine(number)
    random = np.random.default_rng(number or 0)
    whole, other = (course_from(system, start) for _ in range(2))
    assert isinstance(whole, Course)
    assert isinstance(other, Course)
    log = whole.advance(40, store=True)
    for k in range(40):
        other._waiting[0][NEXT:] = random.integers(len(system._automaton.guards), size=MOST_KNOWN)
        one = other.advance(1, store=True)
        assert (one.time[0], one.guard[0]) == (log.time[k], log.guard[k])
        np.testing.assert_array_equal(one.states[0], log.states[k])
    switches = [run._switches.guard[: int(run._clock[SWITCHES])] for run in (whole, other)]
    np.testing.assert_array_equal(*switches)


@pytest.mark.parametrize("decided", [0, 2, 4])
def test_the_error_is_infinite_from_the_impact_that_a_twin_cannot_decide(
    decided: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Rounding decides how many impacts a twin of a body at rest has: here the second one is cut.
    record = ImpactChain(masses=2, frequency=0.9).simulate(impacts=5)
    seeds = []

    def cut(*given: Any, seed: int, **choices: Any) -> Course:
        seeds.append(seed)
        course = Course(*given, seed=seed, **choices)
        if seed == 2:
            whole = course.advance

            def advance(count: int, *, store: bool) -> Impacts:
                return whole(min(count, decided - course.impacts), store=store)

            monkeypatch.setattr(course, "advance", advance)
        return course

    monkeypatch.setattr("dynkit.systems.impact.records.record.course_from", cut)
    error = record.error
    assert seeds == [1, 2, 3]
    assert np.isinf(error).tolist() == [i >= decided for i in range(5)]


def test_matrices_are_simulated_without_computer_algebra_plots_or_files() -> None:
    code = """
import sys
from dynkit.systems import MatrixOscillator
system = MatrixOscillator(M=[[1.0]], C=[[0.1]], K=[[1.0]], frequency=0.9)
system.simulate(impacts=3)
print(sorted({"sympy", "matplotlib", "h5py", "tqdm"} & set(sys.modules)))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_default_start_is_made_once_and_stays_at_home() -> None:
    chain = ImpactChain(masses=2, frequency=0.9)
    assert chain.simulate(impacts=1).start is chain.simulate(impacts=2).start is chain.default_start
    assert "_default_start" not in vars(pickle.loads(pickle.dumps(chain)))


def test_runs_one_after_another_have_the_same_work_space(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = ImpactChain(masses=4, frequency=0.87)
    first = chain.simulate(impacts=20)
    monkeypatch.setattr(runs, "workspace", None)
    again = chain.simulate(impacts=20)
    assert again._run.log.states.tobytes() == first._run.log.states.tobytes()


def test_a_run_has_one_work_space_for_all_modes_that_it_finds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spaces: list[int] = []

    def counted(slots: int, plain: Any = propagators.workspace) -> Any:
        spaces.append(slots)
        return plain(slots)

    monkeypatch.setattr(runs, "workspace", counted)
    chain = ImpactChain(masses=4, restitution=0.3, frequency=0.4)
    chain._structure.automata.clear()  # another oscillator may have entered contact
    for more in (1, 0):  # the first motion enters contact, and has room for its states made
        spaces.clear()
        runs._LENT.clear()
        assert len(chain.simulate(impacts=100).sticking)
        assert len(spaces) == 1 + more


def test_a_label_follows_disturbances_over_two_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[int] = []

    def counted(*arguments: Any, plain: Any = tangents.steps_of) -> Any:
        found = plain(*arguments)
        flown.append(len(found.first))
        return found

    monkeypatch.setattr(tangents, "steps_of", counted)
    attractor = ImpactChain(masses=4, frequency=0.87).attractor(transient=700, keep=100)
    assert attractor.label.stable
    assert flown == [2 * (attractor.label.iterates or 0)]


@dataclass(frozen=True, kw_only=True)
class Weighted(ImpactChain):
    """A chain with arrays in a field of its own."""

    weights: Any = ()


def test_structures_are_taken_over_where_numbers_and_own_objects_are_the_same() -> None:
    weights, elements = (np.ones(2), np.ones(2)), (HardStop(1), SoftStop(0, stiffness=2.0))
    plain = Weighted(masses=(1.0, 2.0), frequency=0.9, weights=weights)
    for system in (plain, plain.replace(elements=elements)):
        assert system._structure is system._structure
        for same in ({"frequency": 0.8}, {"masses": (1.0, 2.0), "weights": weights}):
            assert "_structure" in vars(system.replace(**same))
        for other in ((np.ones(2), np.ones(2)), (1.0, np.ones(2)), (1.0, 1.0)):
            assert "_structure" not in vars(system.replace(weights=other))
