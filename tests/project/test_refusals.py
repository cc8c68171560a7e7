"""Wrong arguments are refused in one clear line: no foreign exception, and none is ignored."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import (
    Basins,
    Branch,
    Dataset,
    HybridFlow,
    Hyperplane,
    MapAttractor,
    MapOrbit,
    Network,
    PoincareMap,
    ResetMap,
    Stroboscope,
    Sweep,
    basins,
    continue_curve,
    continue_orbit,
    equilibrium,
    explore,
    parameter_map,
    periodic_orbit,
    sweep,
)
from dynkit.analysis import (
    BifurcationDiagram,
    CorrelationDimension,
    LyapunovSpectrum,
    PowerSpectrum,
    RunningHistogram,
    Sensitivity,
    SpaceTime,
    StroboscopicSection,
    TimeSeries,
    WorkPrecision,
)
from dynkit.cli import main
from dynkit.core.validation import within_memory
from dynkit.systems import (
    HardStop,
    Henon,
    HenonHeiles,
    ImpactChain,
    ImpactOscillator,
    ImpactRod,
    IntegratedFlow,
    Logistic,
    Lorenz,
    MatrixOscillator,
    SymbolicHybridFlow,
)

BRIEF: dict[str, Any] = {"transient": 5, "keep": 5, "progress": False}
ANY: Any = None
PAIR: Any = np.array(["phase", "time"])


def chain(**options: Any) -> ImpactChain:
    return ImpactChain(**{"masses": 2, "frequency": 0.9, **options})


@cache
def branch() -> Branch:
    orbit = periodic_orbit(Logistic(2.9), [0.6])
    return continue_orbit(orbit, "rate", bounds=(2.85, 2.95))


@cache
def swept() -> Sweep:
    return sweep(Logistic(2.9), "rate", [2.9, 3.2], start=[0.3], **BRIEF)


def masked(*numbers: float) -> Any:
    return np.ma.array(numbers, mask=[False, True, *[False] * (len(numbers) - 2)])


@cache
def found() -> Basins:
    return basins(Logistic(2.9), [[0.3], [0.4]], **BRIEF)


class Losing(IntegratedFlow, HybridFlow):
    dimension = 2

    def velocity(self, state: Any) -> Any:
        return np.array([state[1], -state[0]])

    def guard(self, state: Any) -> float:
        return float(1.0 - state[0])

    def reset(self, state: Any) -> Any:
        return state[:1]


class Doubtful(SymbolicHybridFlow):
    def velocity(self, x: Any, v: Any) -> Any:
        return v, -x

    def guard(self, x: Any, v: Any) -> Any:
        return 1 - x, 2

    def reset(self, x: Any, v: Any) -> Any:
        return x, -v


def diagram(**options: Any) -> BifurcationDiagram:
    given = {"parameter": "a", "values": [1.0, 2.0], "observables": {"x": np.ones((2, 1))}}
    return BifurcationDiagram(**given | options)


def rod(**options: Any) -> ImpactRod:
    return ImpactRod(frequency=1.0, **options)


HUGE, MANY = 10**30, 10**12
CASES: list[tuple[Callable[[], Any], str]] = [
    # of another type than what is asked for
    (
        lambda: continue_curve(branch(), ("rate", "s"), bounds=((2.8, 3.2), (0.9, 1.1))),  # type: ignore[arg-type]
        "bifurcation must be one of a branch's bifurcations; got <Branch",
    ),
    (
        lambda: PoincareMap(Henon(), Hyperplane([0.0, 1.0]), time_limit=1.0),  # type: ignore[arg-type]
        "flow must be a Flow; got Henon(",
    ),
    (
        lambda: PoincareMap(Lorenz(), (2, 27.0), time_limit=1.0),  # type: ignore[arg-type]
        "section must be a PoincareSection; got (2, 27.0)",
    ),
    (
        lambda: PoincareMap(HenonHeiles(), Hyperplane([0, 1, 0, 0]), 50.0, level=0.1),  # type: ignore[arg-type]
        "level must be a pair of a name and a value; got 0.1",
    ),
    (
        lambda: Hyperplane([0.0, 1.0], angles=1),  # type: ignore[arg-type]
        "angles must be a sequence of indices; got 1",
    ),
    (
        lambda: Stroboscope(3, angles=1),  # type: ignore[arg-type]
        "angles must be a sequence of indices; got 1",
    ),
    (
        lambda: CorrelationDimension(np.eye(80), angles=[0]),  # type: ignore[arg-type]
        "angles must be turns of coordinates by number, as {0: 2 * pi}; got [0]",
    ),
    (
        lambda: BifurcationDiagram("a", [1.0, 2.0], [[1.0], [2.0]]),  # type: ignore[arg-type]
        "observables must be arrays by name; got [[1.0], [2.0]]",
    ),
    (
        lambda: WorkPrecision.of(chain(), start=[0.1, 0.2]),
        "start must be an ImpactState; got [0.1, 0.2]: state(position, velocity) makes one",
    ),
    (
        lambda: RunningHistogram(0, low=0.0, high=1.0),  # type: ignore[arg-type]
        "observable must be a name; got 0",
    ),
    (
        lambda: Dataset([1.0], {}, {}),  # type: ignore[arg-type]
        "coordinates must be dimensions and values by name; got [1.0]",
    ),
    # contradictory arguments
    (
        lambda: chain().periodic_orbit(impacts=3, periods=2, phases=[1.0]),
        "impacts must be the number of phases, 1; got 3",
    ),
    (lambda: chain().periodic_orbit(sides=[0]), "sides must not be given without phases; got [0]"),
    # truth
    (lambda: chain().periodic_orbit(sticking="yes"), "sticking must be True or False; got 'yes'"),  # type: ignore[arg-type]
    (lambda: chain().periodic_orbits(sticking=1), "sticking must be True or False; got 1"),  # type: ignore[arg-type]
    (
        lambda: sweep(chain(), "frequency", [0.9], follow="no", **BRIEF),  # type: ignore[arg-type]
        "follow must be True or False; got 'no'",
    ),
    (
        lambda: sweep(chain(), "frequency", [0.9], progress="no"),  # type: ignore[arg-type]
        "progress must be True or False; got 'no'",
    ),
    (
        lambda: parameter_map(chain(), {"frequency": [0.9], "amplitude": [0.1]}, progress=ANY),
        "progress must be True or False; got None",
    ),
    (lambda: basins(Logistic(2.9), [[0.3]], progress=0), "progress must be True or False; got 0"),  # type: ignore[arg-type]
    (
        lambda: continue_orbit(branch().orbit(0), "rate", bounds=(2.8, 3.0), inadmissible="no"),  # type: ignore[arg-type]
        "inadmissible must be True or False; got 'no'",
    ),
    (
        lambda: BifurcationDiagram.of(swept(), labelled="no"),  # type: ignore[arg-type]
        "labelled must be True or False; got 'no'",
    ),
    # masks
    (
        lambda: sweep(chain(), "frequency", masked(0.8, 0.9), **BRIEF),
        "values must have no masked element; got one at [1]",
    ),
    (
        lambda: chain(constant_forces=masked(0.0, 1.0)),
        "constant_forces must have no masked element; got one at [1]",
    ),
    (
        lambda: chain(springs=masked(1.0, 2.0)),
        "springs must have no masked element; got one at [1]",
    ),
    (
        lambda: basins(Logistic(2.9), np.ma.array([[0.3], [0.4]], mask=[[False], [True]])),
        "starts must have no masked element; got one at [1, 0]",
    ),
    (lambda: Henon()(masked(0.1, 0.2)), "state must have no masked element; got one at [1]"),
    (
        lambda: BifurcationDiagram("a", np.ones(1), {"x": np.ma.array([[1.0]], mask=[[True]])}),
        "observables['x'] must have no masked element; got one at [0, 0]",
    ),
    # numbers
    (lambda: chain(contact=1.5), "contact must be an integer; got 1.5"),
    (lambda: chain(contact=(0, 1)), "contact must be an integer; got (0, 1)"),
    (lambda: chain(contact=True), "contact must be an integer; got True"),
    (lambda: chain(contact=2), "contact must lie in [-2, 1]; got 2"),
    (lambda: chain(masses=10**20), "masses must be below 2^63; got 1000000"),
    (lambda: chain(masses=10**9), "masses must fit into "),
    (lambda: chain().simulate(impacts=HUGE), "impacts must be below 2^63"),
    (lambda: chain().simulate(impacts=MANY), "impacts must fit into "),
    (lambda: chain().attractor(transient=HUGE), "transient must be below 2^63"),
    (lambda: chain().attractor(impacts=MANY), "impacts must fit into "),
    (lambda: sweep(chain(), "frequency", [0.9], keep=MANY), "keep must fit into "),
    (
        lambda: parameter_map(chain(), {"frequency": [0.9], "offset": [0.0]}, keep=MANY),
        "keep must fit into ",
    ),
    (lambda: basins(chain(), [[0.0, 1.0, 0.0, 0.0, 0.0]], keep=MANY), "keep must fit into "),
    (lambda: chain().periodic_orbit(impacts=10**6), "impacts must fit into "),
    (
        lambda: chain().periodic_orbit(periods=10**6, phases=np.arange(10**6)),
        "phases must fit into ",
    ),
    (lambda: periodic_orbit(Logistic(2.9), [0.3], period=10**7), "period must fit into "),
    (lambda: Logistic(2.9).iterate([0.3], MANY), "n must fit into "),  # type: ignore[arg-type]
    (lambda: MapAttractor(Logistic(2.9), [0.3], MANY, 1), "transient + iterations must fit into "),  # type: ignore[arg-type]
    (lambda: branch().orbit(1.5), "place must be an integer; got 1.5"),  # type: ignore[arg-type]
    (lambda: swept().attractor(0.5), "place must be an integer; got 0.5"),  # type: ignore[arg-type]
    (lambda: swept().label("first"), "place must be an integer; got 'first'"),  # type: ignore[arg-type]
    # kinds
    (
        lambda: sweep(Logistic(2.9), "rate", [2.9], start=[0.3], store=5, **BRIEF),  # type: ignore[arg-type]
        "store must be a path; got 5",
    ),
    (lambda: Sweep.load(None), "store must be a path; got None"),  # type: ignore[arg-type]
    (lambda: branch().save(5), "store must be a path; got 5"),  # type: ignore[arg-type]
    (
        lambda: explore(Logistic(2.9), "rate", (2.8, 3.0), seeds=5),  # type: ignore[arg-type]
        "seeds must be periodic orbits or equilibria; got 5",
    ),
    (
        lambda: explore(Logistic(2.9), "rate", (2.8, 3.0), seeds=[0.5]),  # type: ignore[list-item]
        "seeds[0] must be a PeriodicOrbit or an Equilibrium; got 0.5",
    ),
    (
        lambda: Network.load("none.h5", branch().orbit(0)),
        "orbits must be a sequence of orbits; got <P(1) of Logistic",
    ),
    (
        lambda: sweep(ImpactChain, "frequency", [0.9], **BRIEF),  # type: ignore[arg-type]
        "system must be an instance, such as ImpactChain(...); got the class ImpactChain",
    ),
    (
        lambda: parameter_map(Henon, {"a": [1.0], "b": [0.3]}, **BRIEF),  # type: ignore[arg-type]
        "system must be an instance, such as Henon(...); got the class Henon",
    ),
    (
        lambda: basins(Logistic, [[0.3]], **BRIEF),  # type: ignore[arg-type]
        "system must be an instance, such as Logistic(...); got the class Logistic",
    ),
    (
        lambda: periodic_orbit(Logistic, [0.3]),  # type: ignore[arg-type]
        "system must be an instance, such as Logistic(...); got the class Logistic",
    ),
    (
        lambda: MapAttractor(Logistic, [0.3], 1, 1),  # type: ignore[arg-type]
        "system must be an instance, such as Logistic(...); got the class Logistic",
    ),
    (lambda: BifurcationDiagram.of(5), "sweep must be a Sweep; got 5"),  # type: ignore[arg-type]
    *(
        (partial(diagram, **{name: given}), f"{name} must be {limit}; got {given!r}")
        for name, given, limit in (
            ("parameter", 3, "a name"),
            ("labels", 3, "a sequence of labels or texts"),
            ("labels", "ab", "a sequence of labels or texts"),
            ("labels", [1, 2], "a sequence of labels or texts"),
            ("symbols", ["a"], "texts by name"),
        )
    ),
    (lambda: diagram(symbols={"x": 3}), "symbols['x'] must be a text; got 3"),
    (lambda: swept().export(3), "path must be a path; got 3"),  # type: ignore[arg-type]
    (lambda: swept().view(out=3, show=False), "out must be a path; got 3"),  # type: ignore[arg-type]
    (
        lambda: swept().view(out="no/such/folder/x.html", show=False),
        "out must be in a folder that exists; got 'no/such/folder/x.html'",
    ),
    # results of another kind
    (lambda: Branch.load("none.h5", 3), "orbit must be a PeriodicOrbit or an Equilibrium; got 3"),  # type: ignore[arg-type]
    (
        lambda: Network.load("none.h5", [3]),  # type: ignore[list-item]
        "orbits[0] must be a PeriodicOrbit or an Equilibrium; got 3",
    ),
    (lambda: Basins.load("none.h5", 3), "system must be a Map; got 3"),  # type: ignore[arg-type]
    (lambda: MapOrbit.load("none.h5", 3), "system must be a Map or a Flow; got 3"),
    (
        lambda: MapOrbit.load("none.h5", Logistic),
        "system must be an instance, such as Logistic(...); got the class Logistic",
    ),
    (lambda: swept().attractor(0).section(3), "section must be a PoincareSection; got 3"),  # type: ignore[arg-type]
    (lambda: found().attractor("first"), "place[0] must be an integer; got 'first'"),  # type: ignore[arg-type]
    (lambda: found().attractor(0, 0), "place must have 1 indices; got (0, 0)"),
    (
        lambda: equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0]).lyapunov_orbits("energy"),
        "integral must be a known name, and there is none; got 'energy'",
    ),
    # flows that jump
    (
        lambda: ResetMap(Losing(), 10.0)(np.array([0.0, 2.0])),
        "Losing.reset must return 2 real numbers, (2,); got array([1.])",
    ),
    (
        lambda: ResetMap(Doubtful(), 10.0)(np.array([0.0, 2.0])),
        "guard must return one expression; got (1 - x, 2)",
    ),
    # machines
    (lambda: rod().moving("a", 1.0), "displacement must be a finite number; got 'a'"),  # type: ignore[arg-type]
    (lambda: rod().displacements("a"), "coordinates must be an array of real numbers; got 'a'"),
    (
        lambda: rod().displacements([np.nan] * 100),
        "coordinates[0] must be a finite number; got nan",
    ),
    (lambda: rod().truncation_errors(3), "record must be an ImpactRecord; got 3"),  # type: ignore[arg-type]
    (lambda: rod(wave_speed=1e300), "wave_speed must lie in [5e-33, 5e+27] with length 1.0 and "),
    (lambda: rod(wave_speed=1e-300), "wave_speed must lie in [5e-33, 5e+27] with length 1.0 and "),
    (lambda: rod(length=1e300), "length must give distances and masses between 1e-30 and 1e+30"),
    (lambda: rod(density=1e-300), "density must give distances and masses between 1e-30 and 1e+30"),
    (lambda: rod(masses=10**6), "masses must fit into "),
    (
        lambda: (
            chain(elements=[HardStop(0, offset=0.5), HardStop(0, offset=0.2, side="below")])
            .attractor()
            .label
        ),
        "room between their stops; got position[0] >= 0.5 and position[0] <= 0.2 at phase 0",
    ),
    (lambda: branch().plot(ax=5), "ax must be axes of matplotlib; got 5"),  # type: ignore[arg-type]
    (lambda: swept().plot(ax=5), "ax must be axes of matplotlib; got 5"),  # type: ignore[arg-type]
    # messages
    (
        lambda: CorrelationDimension(np.arange(500.0)),
        "must have 2 dimensions; got shape (500,); a single coordinate is states[:, None]",
    ),
    (
        lambda: parameter_map(chain(), {"frequency": [0.9], "damping": [-0.1]}, **BRIEF),
        "damping must not be negative; got -0.1 in values['damping'][0]",
    ),
    (
        lambda: MatrixOscillator(M=np.eye(2), C=np.eye(2), K=[[1, 0.1], [0.2, 1]], frequency=1),
        "got 0.1 at [0, 1] and 0.2 across; (K + K.T) / 2 is symmetric",
    ),
    (
        lambda: chain().simulate(impacts=2).observable(PAIR),
        "name must be one of: relative_velocity, phase, energy, time",
    ),
]


@pytest.mark.parametrize(("call", "message"), CASES, ids=[message for _, message in CASES])
def test_a_wrong_argument_is_refused_by_name(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        call()
    assert "\n" not in str(refusal.value)


def test_what_fits_into_memory_is_taken() -> None:
    assert within_memory("impacts", 1000, 8000.0) == 1000


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[chain]\nmasses = 2\n", "must hold only "),
        ("frequency = {value = 0.9}\n", "frequency must be a finite number; got {'value': 0.9}"),
        ("frequency = 0.9\nmasses = {count = 2}\n", "masses must be "),
        ("frequency = 0.9\nsprings = [[1.0], [2.0]]\n", "springs must have shape "),
        ("frequency = " + "[" * 5000 + "]" * 5000, "must be a TOML file: "),
    ],
)
def test_nested_toml_is_refused_in_one_line(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "x.toml"
    file.write_text(text)
    assert main(["simulate", str(file)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert message in told


def test_toml_with_a_byte_order_mark_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(b"\xef\xbb\xbffrequency = 0.9\nmasses = 2\ntransient = 5\nimpacts = 5\n")
    assert main(["simulate", str(file)]) == 0
    assert capsys.readouterr().err == ""


def test_an_export_is_no_store_and_the_refusal_says_what_makes_one(tmp_path: Path) -> None:
    file = tmp_path / "x.csv"
    file.write_text("rate,state[0]\n")
    with pytest.raises(ValueError, match=r"as store=, --store and save\(\) write; got "):
        Sweep.load(file)


@dataclass(frozen=True)
class Heavy(Logistic):
    g: Any = 1.0


def test_an_integer_is_the_same_parameter_as_its_float_in_a_store(tmp_path: Path) -> None:
    for follow in (True, False):
        store = tmp_path / f"{follow}.h5"
        options: dict[str, Any] = {"start": [0.3], "store": store, "follow": follow, **BRIEF}
        first = sweep(Heavy(2.9, g=1), "rate", [2.9], **options)
        again = sweep(Heavy(2.9, g=1.0), "rate", [2.9], **options)
        assert np.array_equal(first.observable("state[0]"), again.observable("state[0]"))
        with pytest.raises(ValueError, match=r"was made with g 1; got 2\.0"):
            sweep(Heavy(2.9, g=2.0), "rate", [2.9], **options)


def test_a_store_of_a_machine_with_another_element_is_refused_by_the_name_of_its_number(
    tmp_path: Path,
) -> None:
    walls = [HardStop(0, amplitude=0.1, name="wall", restitution=r) for r in (0.5, 0.6)]
    one, other = (chain(elements=[wall]) for wall in walls)
    sweep(one, "frequency", [0.9], store=tmp_path / "x.h5", **BRIEF)
    with pytest.raises(ValueError, match=r"was made with wall\.restitution 0\.5; got 0\.6"):
        Sweep.load(tmp_path / "x.h5", other)


# --- systems --------------------------------------------------------------------------------------


def test_the_rounding_of_a_product_of_matrices_is_no_asymmetry() -> None:
    random = np.random.default_rng(0)
    asymmetric = 0
    for _ in range(40):
        n = int(random.integers(2, 7))
        b, k = random.normal(size=(2, n, n))
        stiffness = b.T @ (k @ k.T + np.eye(n)) @ b
        asymmetric += bool((stiffness != stiffness.T).any())
        found = MatrixOscillator(M=np.eye(n), C=np.zeros((n, n)), K=stiffness, frequency=1.0)
        taken = np.array(found.K)
        assert (taken == taken.T).all()
        assert abs(taken - stiffness).max() <= n * 2.0**-52 * abs(stiffness).max()
    assert asymmetric > 20


@dataclass(frozen=True, kw_only=True)
class Leaning(ImpactOscillator):
    """One mass whose weight is in its potential."""

    degrees_of_freedom = 1

    def kinetic(self, v: Any) -> Any:
        return v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 / 2 + x[0]


def test_a_linear_potential_points_to_constant_forces() -> None:
    with pytest.raises(ValueError, match="is of degree 1, a constant force: give it as constant_f"):
        Leaning(frequency=1.0).simulate(impacts=1)


# --- records --------------------------------------------------------------------------------------


def test_measures_of_attractors_take_records() -> None:
    record: Any = chain(frequency=0.9).simulate(impacts=300)
    attractor = chain(frequency=0.9).attractor(transient=0, impacts=300)
    times = np.linspace(0.0, 50.0, 20)
    assert np.array_equal(record.as_attractor().states, attractor.states)
    assert np.array_equal(TimeSeries(record, times).values, TimeSeries(attractor, times).values)
    assert np.array_equal(StroboscopicSection(record).states, StroboscopicSection(attractor).states)
    assert np.array_equal(
        SpaceTime(record, times).displacements, SpaceTime(attractor, times).displacements
    )
    assert np.array_equal(CorrelationDimension(record).states, attractor.states)
    few: dict[str, Any] = {"iterations": 128}
    assert np.array_equal(
        LyapunovSpectrum(record, **few).exponents,
        LyapunovSpectrum(attractor, **few).exponents,
    )
    parted = Sensitivity(record, **few).distances
    assert np.array_equal(parted, Sensitivity(attractor, **few).distances)
    assert PowerSpectrum(record).name == PowerSpectrum(attractor).name
