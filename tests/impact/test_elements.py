"""Soft stops beside a table, against the same motion in many digits."""

import cmath
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    MatrixOscillator,
    PlasticBelow,
    SoftStop,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.sampling import sample_run
from dynkit.systems.impact.simulation.trajectory import Ending, Trajectory
from tests.impact.agreement import moves_as_in_many_digits
from tests.impact.own_laws import Hardening
from tests.reference.soft_stops import DIGITS, SoftStopReference

SPRING = 7.0
PLACE = 0.05


def machine(
    *,
    along: Any = -1,
    lag: float = 0.0,
    dashpot: float = 0.0,
    preload: float = 0.0,
    movement: complex = 0.1,
    between: Any = 0,
    restitution: float = 0.6,
    amplitude: float = 0.1,
    offset: float = 0.0,
    frequency: float = 0.9,
    masses: int = 2,
    **forces: Any,
) -> ImpactChain:
    """A chain above a table, with a soft stop that moves: of a mass, or between two."""
    table = HardStop(
        along,
        amplitude=amplitude,
        restitution=restitution,
        offset=offset,
        phase=lag,
        name="table",
    )
    cushion = SoftStop(
        between,
        offset=PLACE,
        amplitude=abs(movement),
        phase=-cmath.phase(movement),
        stiffness=SPRING,
        damping=dashpot,
        preload=preload,
    )
    return ImpactChain(masses=masses, frequency=frequency, elements=[table, cushion], **forces)


def motion(chain: ImpactChain, count: int, place: Any = None) -> tuple[Trajectory, Array]:
    start = chain.state(place)
    run = chain._run(start, count, store=True)
    return run, np.concatenate([start.position, start.velocity])


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize(("masses", "amplitude"), [(1, 0.5), (2, 0.1), (3, 0.1)])
def test_a_soft_stop_gives_the_motion_of_many_digits(
    masses: int, amplitude: float, dashpot: float
) -> None:
    chain = machine(
        masses=masses, frequency=0.9, restitution=0.6, amplitude=amplitude, dashpot=dashpot
    )
    run, start = motion(chain, 12)
    assert run.impacts == 12
    assert run.guards[run.log.guard, 0].any()  # some impacts are while the spring pushes
    switched = run.segments.kind == EventKind.SWITCH
    assert (run.segments.element[switched] == 1).sum() >= 4
    assert not len(run.contacts)
    with mp.workdps(DIGITS):
        expected = SoftStopReference(chain).impacts(start, 12)
    compare(chain, run, expected)


@pytest.mark.parametrize("restitution", [0.7, 0.0])
@pytest.mark.parametrize("along", [(0, 1), (2, 0), [0.5, -1.0, 1.5]])
def test_a_hard_stop_acts_along_any_row(along: Any, restitution: float) -> None:
    chain = machine(
        masses=3, along=along, lag=0.7, restitution=restitution, amplitude=0.3, between=(1, 2)
    )
    run, start = motion(chain, 12)
    assert run.impacts == 12
    assert bool(len(run.contacts)) is (restitution == 0.0)
    with mp.workdps(DIGITS):
        expected = SoftStopReference(chain).impacts(start, 12)
    compare(chain, run, expected)


def compare(
    chain: ImpactChain, run: Trajectory, expected: list[tuple[Any, Any]], most: float = 1e-12
) -> None:
    """Times and states of the impacts, with what they should be."""
    size = chain.dimension
    with mp.workdps(DIGITS):
        late = [
            abs(float(mp.mpf(t) - e)) for t, (e, _) in zip(run.time.tolist(), expected, strict=True)
        ]
    states = np.array([[float(number) for number in z] for _, z in expected])[:, :size]
    record = ImpactRecord(chain, run)
    apart = abs(np.concatenate([record.position, record.velocity], axis=1) - states).max(axis=1)
    assert (apart <= record.error).all()
    assert (np.array(late) * chain.frequency <= record.error + 2.0**-50 * run.time).all()
    assert max(*late, *apart) < most
    sampled = sample_run(chain, run, run.time)
    assert abs(np.concatenate(sampled, axis=1) - states).max() < most


def random_machine(
    seed: int, *, anywhere: bool = False, preloaded: bool = False
) -> tuple[ImpactChain, Array, Array]:
    """A chain with one to three soft stops of any kind, and where it starts."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    own: dict[str, Any] = {
        "amplitude": random.uniform(0.05, 0.4),
        "restitution": random.choice([0.0, random.uniform(0.3, 0.95)]),
    }
    along: Any = n - 1
    if anywhere:
        along, own["phase"] = random_row(random, n), random.uniform(-3.0, 3.0)
        own["side"] = str(random.choice(["above", "below"]))
    stops: list[Any] = [HardStop(along, **own)]
    stops += [
        SoftStop(
            random_row(random, n),
            offset=random.uniform(-0.3, 0.3),
            amplitude=random.choice([0.0, random.uniform(0.0, 0.3)]),
            phase=random.uniform(-3.0, 3.0),
            side=str(random.choice(["above", "below"])),
            stiffness=10.0 ** random.uniform(-0.5, 1.5),
            damping=random.choice([0.0, 10.0 ** random.uniform(-2.0, 0.5)]),
        )
        for _ in range(int(random.integers(1, 4)))
    ]
    if preloaded:
        stops[1:] = [replace(stop, preload=random.uniform(0.0, 1.0)) for stop in stops[1:]]
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        damping=random.choice([0.0, 0.1, 0.3]),
        frequency=random.uniform(0.3, 1.5),
        elements=[stops[k] for k in random.permutation(len(stops))],
    )
    place = random.normal(size=n)
    if anywhere:
        (stop,) = (element for element in stops if isinstance(element, HardStop))
        middle = stop.swing(0.0, 1.0)
        row = stop.row(n)
        place += row * (middle + stop.sign * abs(random.normal()) - row @ place) / (row @ row)
    else:
        place[-1] = abs(place[-1])
    return chain, place, random.normal(size=n)


def random_row(random: np.random.Generator, n: int) -> Any:
    """One coordinate, any row, or a pair of two."""
    rows: list[Any] = [int(random.integers(n)), random.normal(size=n)]
    if n > 1:
        rows.append(tuple(random.permutation(n)[:2].tolist()))
    return rows[int(random.integers(len(rows)))]


def by_law(chain: ImpactChain, seed: int) -> ImpactChain:
    """The same, each of its hard stops with a law of its own."""
    random = np.random.default_rng(seed)
    laws = [
        ViscoelasticSpheres(random.uniform(0.05, 0.6)),
        PlasticBelow(random.uniform(0.0, 0.5), rebound=random.uniform(0.3, 0.95)),
        Hardening(random.uniform(0.1, 0.9), random.uniform(0.2, 2.0)),
    ]
    return chain.replace(
        elements=[
            replace(e, restitution=laws[random.integers(3)]) if isinstance(e, HardStop) else e
            for e in chain.elements
        ]
    )


def with_several_stops(seed: int) -> tuple[ImpactChain, Array, Array]:
    """A chain with two to four hard stops anywhere, and up to two soft ones; where it starts."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    stops: list[Any] = [
        HardStop(
            random_row(random, n),
            offset=random.uniform(-0.5, 0.2),
            amplitude=random.choice([0.0, random.uniform(0.0, 0.4)]),
            phase=random.uniform(-3.0, 3.0),
            restitution=random.choice([0.0, random.uniform(0.3, 0.95)]),
        )
        for _ in range(int(random.integers(2, 5)))
    ]
    for k, stop in enumerate(stops):
        if random.random() < 0.5:
            stops[k] = replace(stop, side="below", offset=-stop.offset)
    stops += [
        SoftStop(
            random_row(random, n),
            offset=random.uniform(-0.3, 0.3),
            stiffness=10.0 ** random.uniform(-0.5, 1.5),
            damping=random.choice([0.0, 10.0 ** random.uniform(-2.0, 0.5)]),
        )
        for _ in range(int(random.integers(0, 3)))
    ]
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        damping=random.choice([0.0, 0.1, 0.3]),
        frequency=random.uniform(0.3, 1.5),
        harmonic_forces=random.normal(size=n),
        constant_forces=0.3 * random.normal(size=n),
        elements=[stops[k] for k in random.permutation(len(stops))],
    )
    place = chain.state().position
    return chain, place, random.normal(size=n)


# in the last eight a dashpot tears the mass off the table, or a spring is all but grazed
@pytest.mark.parametrize("seed", [*range(16), 1027, 1073, 1087, 1259, 1275, 1327, 1329, 1341])
def test_random_machines_move_as_in_many_digits(seed: int) -> None:
    moves_as_in_many_digits(*random_machine(seed), impacts=8, most=1e-8)


@pytest.mark.parametrize("seed", [*range(20), 1027, 1073, 1087, 1259])
def test_random_machines_with_preloaded_stops(seed: int) -> None:
    machine = random_machine(seed, preloaded=True)
    moves_as_in_many_digits(*machine, impacts=8, most=1e-8)


@pytest.mark.parametrize("seed", range(24))
def test_random_machines_with_a_hard_stop_anywhere(seed: int) -> None:
    machine = random_machine(seed, anywhere=True)
    moves_as_in_many_digits(*machine, impacts=8, most=1e-8)


@pytest.mark.parametrize("seed", [seed for seed in range(40) if seed not in (14, 27, 35)])
def test_random_machines_with_several_hard_stops(seed: int) -> None:
    moves_as_in_many_digits(*with_several_stops(seed), impacts=8, most=1e-8)


@pytest.mark.parametrize("seed", range(24))
def test_random_machines_with_impact_laws(seed: int) -> None:
    chain, place, velocity = random_machine(seed, anywhere=True, preloaded=seed % 2 == 0)
    moves_as_in_many_digits(by_law(chain, seed), place, velocity, impacts=8, most=1e-8)


@pytest.mark.parametrize("seed", [seed for seed in range(24) if seed not in (14,)])
def test_random_machines_with_several_impact_laws(seed: int) -> None:
    chain, place, velocity = with_several_stops(seed)
    moves_as_in_many_digits(by_law(chain, seed), place, velocity, impacts=8, most=1e-8)


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
def test_a_motion_may_begin_where_an_element_acts(dashpot: float) -> None:
    chain = machine(masses=2, frequency=0.9, restitution=0.6, dashpot=dashpot)
    run, start = motion(chain, 8, [-0.5, 1.0])
    with mp.workdps(DIGITS):
        expected = SoftStopReference(chain).impacts(start, 8)
    compare(chain, run, expected)
    assert run.segments.kind[1] == EventKind.SWITCH
    assert run.segments.begin[1] == 0.0
    events = ImpactRecord(chain, run).events
    assert events.time[0] > 0.0
    assert len(events) == len(run.segments.kind) - 2


def test_a_motion_goes_on_from_where_an_element_acts() -> None:
    chain = machine(masses=2, frequency=0.9, restitution=0.6, dashpot=0.6)
    whole = chain.simulate(impacts=12)
    pressed = [k for k in range(1, 11) if whole._run.guards[whole._run.log.guard[k - 1], 0]]
    assert pressed
    for k in pressed:
        first = chain.simulate(impacts=k)
        rest = chain.simulate(impacts=12 - k, start=first.final)
        assert np.abs(rest.states - whole.states[k:]).max() < 1e-12


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize(("masses", "between"), [(2, 0), (3, 0), (3, (0, 1)), (3, (2, 1))])
def test_an_element_acts_while_a_mass_lies_on_the_table(
    masses: int, between: Any, dashpot: float
) -> None:
    chain = machine(
        masses=masses,
        frequency=0.55,
        restitution=0.0,
        amplitude=0.3,
        dashpot=dashpot,
        movement=0.2 + 0.15j,
        between=between,
    )
    run, start = motion(chain, 12)
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain)
        expected = reference.impacts(start, 12)
    assert reference.switches_in_contact >= 4
    assert len(run.contacts) >= 5
    compare(chain, run, expected)


def test_a_spring_that_is_not_touched_costs_nothing() -> None:
    chain = machine(masses=2, frequency=0.9, restitution=0.6, offset=10.0)
    run, _ = motion(chain, 20)
    assert not len(run.switches.time)
    assert len(chain._automaton.modes) == 1


def test_more_guards_and_modes_are_not_compiled_for() -> None:
    from dynkit.systems.impact.simulation import loop_kernels as kernels

    motion(machine(masses=2, frequency=0.9, restitution=0.6), 5)
    compiled: Any = kernels.run
    before = len(compiled.signatures)

    table, cushion = machine().elements
    more = replace(cushion, offset=0.02, stiffness=5.0)
    twice = ImpactChain(masses=2, frequency=0.9, elements=[cushion, table, more])
    run, _ = motion(twice, 5)
    assert len(run.regimes) > 2
    assert len(compiled.signatures) == before


def test_more_modes_than_fit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynkit.systems.impact.simulation.automaton.MOST_NUMBERS", 1 << 9)
    with pytest.raises(MemoryError, match=r"more modes than fit into 256 MB; got \d+"):
        machine().simulate(impacts=20)


def test_kernels_and_elements_number_events_alike() -> None:
    from dynkit.systems.impact.elements import element as elements
    from dynkit.systems.impact.simulation import event_kernels

    for name in ("IMPACT", "SWITCH", "JAM", "HALT", "JUMP"):
        assert getattr(event_kernels, name) == getattr(elements, name)


@pytest.mark.parametrize("dashpot", [0.0, 0.6])
@pytest.mark.parametrize("preload", [0.0, 0.4])
@pytest.mark.parametrize(("restitution", "frequency"), [(0.6, 0.9), (0.0, 0.55)])
def test_derivatives_through_an_element_are_differences(
    restitution: float, frequency: float, preload: float, dashpot: float
) -> None:
    chain = machine(
        masses=2,
        frequency=frequency,
        restitution=restitution,
        amplitude=0.2,
        dashpot=dashpot,
        preload=preload,
        movement=0.1 + 0.05j,
    )
    record = chain.simulate(impacts=40)
    run = record._run
    switched = np.unique(run.switches.before[run.guards[run.switches.guard, 3] == EventKind.SWITCH])
    checked = 0
    for state in record.states[switched[switched > 0][:8] - 1]:
        # where a preload is all but grazed the map bends within larger steps
        exact, size = chain.jacobian(state), 1e-8 if preload else 1e-6
        # without rebound a bounce that the step makes is an impact more
        directions = [k for k in range(chain.dimension) if restitution or k != 2]
        for k in directions:
            step = size * np.eye(chain.dimension)[k]
            change = chain.difference(chain(state + step), chain(state - step)) / (2.0 * size)
            assert abs(exact[:, k] - change).max() < 1e-6 * max(1.0, abs(exact).max())
        checked += 1
    assert checked >= 3
    if restitution:
        logs = chain.stretching(record.states[0], 30).logs.sum(axis=0)
        volumes = [np.linalg.slogdet(chain.jacobian(state))[1] for state in record.states[:30]]
        assert logs.sum() == pytest.approx(sum(volumes), abs=1e-6)
        assert np.isfinite(logs[0])


def test_moments_through_an_element_are_those_of_samples() -> None:
    chain = machine(masses=2, frequency=0.9, restitution=0.6, dashpot=0.6)
    record = chain.simulate(impacts=60)
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    x, _ = record.sample(times)
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    square = np.trapezoid(x[:, :, None] * x[:, None], times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6
    assert abs(moments.products.sum(axis=0) / times[-1] - square).max() < 1e-6


@pytest.mark.parametrize("offset", [-20.0, 20.0])
def test_a_motion_without_impacts_comes_to_an_end(
    offset: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynkit.systems.impact.simulation.runs.MOST_SWITCHES", 100)
    forces = [0.5, 0.0]
    weight = [-20.0, -200.0] if offset > 0 else [0.0, 0.0]
    chain = machine(
        masses=2, frequency=0.9, offset=offset, harmonic_forces=forces, constant_forces=weight
    )
    start = chain.state([0.5, offset], [0.0, 0.09]) if offset > 0 else chain.state([0.5, 0.5])
    record = chain.simulate(impacts=5, start=start)
    assert record.ending is Ending.SEARCH_LIMIT
    assert 100 <= len(record._run.switches.time) <= 300
    assert bool(len(record.sticking)) is (offset > 0)
    more = chain.simulate(impacts=5, start=record.final)
    assert more.ending is Ending.SEARCH_LIMIT


def test_pictures_show_what_presses_and_sticks_along_what_is_asked_for() -> None:
    machine = ImpactChain(
        masses=2,
        frequency=0.4,
        elements=[
            HardStop(1, amplitude=0.3, restitution=0.4, name="table"),
            SoftStop(1, offset=0.5, stiffness=20.0, name="pad"),
            DryFriction(0, force=0.05, static=0.08, velocity=0.02, name="belt"),
        ],
    )
    record = machine.simulate(impacts=40)
    for element, shades in (("belt", {"sticks"}), (None, {"pressed"}), ("pad", {"pressed"})):
        ax = record.plot(element=element)
        labels = ax.get_legend_handles_labels()[1]
        assert {"in contact", "pressed", "sticks"} & set(labels) == shades
        paths = [path.get_extents() for path in ax.collections[0].get_paths()]
        assert paths
        for path in paths[:20]:
            middle = 0.5 * (path.x0 + path.x1)
            (x, v) = record.sample([middle])
            assert v[0, 0] == pytest.approx(0.02) if element == "belt" else x[0, 1] < 0.5
        assert ("belt" in labels) is False
    with pytest.raises(ValueError, match="element must be one of: table, pad, belt; got 'no'"):
        record.plot(element="no")


def pad(damping: float = 0.0, stiffness: float = 0.0) -> MatrixOscillator:
    """A unit mass under a unit weight, above a pad at zero with a preload of three weights."""
    return MatrixOscillator(
        M=[[1.0]],
        C=[[damping]],
        K=[[0.0]],
        frequency=2.0 * np.pi / 3.0,
        constant_forces=[-1.0],
        elements=[SoftStop(0, stiffness=stiffness, preload=3.0, name="pad")],
    )


def test_a_preload_alone_is_a_constant_force() -> None:
    # up with acceleration -1, at the pad with 3 - 1: each unit of velocity takes 2/1 + 2/2
    bouncing = pad()
    record = bouncing.simulate(impacts=4, start=bouncing.state([0.5], [0.0]))
    assert record.states == pytest.approx(np.tile([0.5, 0.0], (4, 1)), abs=1e-13)
    low, rate = record.sample([1.0 + 0.25])  # a quarter after it has met the pad at rate -1
    assert low[0, 0] == pytest.approx(-0.25 + 0.25**2, abs=1e-14)
    assert rate[0, 0] == pytest.approx(-0.5, abs=1e-14)
    balance = record.energy_balance()
    assert abs(balance.dissipated["pad"]) < 1e-13
    assert balance.error < 1e-12


def test_a_preloaded_spring_keeps_its_energy_and_a_dashpot_does_not() -> None:
    machine = pad(stiffness=2.0)
    record = machine.simulate(impacts=5, start=machine.state([0.5], [0.0]))
    x, v = record.position[:, 0], record.velocity[:, 0]
    energy = 0.5 * v**2 + x + np.where(x < 0.0, x**2 - 3.0 * x, 0.0)
    assert energy == pytest.approx(0.5, abs=1e-13)
    assert abs(record.energy_balance().dissipated["pad"]) < 1e-12
    lossy = machine.replace(**{"pad.damping": 0.5})
    balance = lossy.simulate(impacts=1, start=lossy.state([0.5], [0.0])).energy_balance()
    assert balance.dissipated["pad"] > 0.1
    assert balance.error < 1e-12


@pytest.mark.parametrize(("height", "damping"), [(1e-9, 0.0), (0.5, 0.3)])
def test_what_hangs_at_the_edge_of_a_preloaded_stop_ends_with_this_name(
    height: float, damping: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynkit.systems.impact.simulation.runs.MOST_SWITCHES", 2000)
    machine = pad(damping)
    record = machine.simulate(impacts=1000, start=machine.state([height], [0.0]))
    assert record.ending is Ending.HANGS
    assert len(record) < 1000


def test_a_preload_that_is_never_met_changes_nothing() -> None:
    chain = machine(offset=10.0)
    same = machine(offset=10.0, preload=0.7)
    assert np.array_equal(chain.simulate(impacts=20).states, same.simulate(impacts=20).states)


def test_a_small_preload_changes_little() -> None:
    chain = machine(dashpot=0.6)
    states = [
        machine(dashpot=0.6, preload=preload).simulate(impacts=6).states
        for preload in (0.0, 1e-8, 2e-8)
    ]
    first, second = (abs(chain.difference(other, states[0])).max() for other in states[1:])
    assert 0.0 < first < 1e-6
    assert second == pytest.approx(2.0 * first, rel=1e-4)


def test_any_string_is_a_name() -> None:
    table = HardStop(0, name=np.str_("table"))
    rubs = DryFriction(0, coefficient=0.1, normal=np.str_("table"), name=np.str_("belt"))
    assert [type(name) for name in (table.name, rubs.normal, rubs.name)] == [str] * 3
    assert (table, rubs.normal, rubs.name) == (HardStop(0, name="table"), "table", "belt")
