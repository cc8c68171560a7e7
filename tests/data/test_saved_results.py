"""Every result that is saved is read again with the same bits, and shows and draws the same."""

from __future__ import annotations

import csv
import inspect
import io
from pathlib import Path
from typing import Any

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pytest

import dynkit
import dynkit.data.store
from dynkit import Bifurcation, analysis
from dynkit.analysis import (
    POD,
    BifurcationDiagram,
    CorrelationDimension,
    LyapunovSpectrum,
    PowerSpectrum,
    SpaceTime,
    TimeSeries,
)
from dynkit.core.validation import Array
from dynkit.data.dataset import Dataset
from dynkit.data.result import Result, Saved, SavedWithSystem
from dynkit.exponential.sums import Root
from dynkit.labels.label import OrbitLabel
from dynkit.orbits.families import FamilySolution
from dynkit.systems import (
    Duffing,
    Henon,
    ImpactChain,
    ImpactDuffing,
    ImpactRecord,
    Logistic,
    Lorenz,
)
from tests.data.machines import entered, machine
from tests.public_classes import example, measures, public_classes
from tests.testing.test_problems import Balance, BalanceProblem, rest

MEASURES = {name: kind for name, kind in measures().items() if issubclass(kind, Saved)}


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    chain = ImpactChain(masses=2, frequency=0.9)
    motion = chain.attractor(transient=100, impacts=60)
    henon = Henon().attractor(start=[0.1, 0.1], transient=100, keep=600)
    states = henon.states
    logistic = dynkit.periodic_orbit(Logistic(rate=2.9), [0.6])
    branch = dynkit.continue_orbit(logistic, "rate", bounds=(2.5, 3.4))
    orbit = dynkit.periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    (doubling,) = dynkit.continue_orbit(orbit, "a", bounds=(0.1, 1.4)).bifurcations
    bounds = ((0.0, 3.0), (-0.9, 0.9))
    short: dict[str, Any] = {"start": [0.3], "transient": 50, "keep": 5, "progress": False}
    sweep = dynkit.sweep(Logistic(rate=3.5), "rate", [3.1, 3.5, 3.9], **short)
    plane = {"a": [0.2, 0.3], "b": [0.1, 0.3]}
    several, flow = machine(), dynkit.PoincareMap(Duffing(), dynkit.Stroboscope(3), 10.0)
    box = [(-2.0, 2.0), (-2.0, 2.0)]
    smooth = ImpactDuffing(frequency=0.9).simulate(impacts=5)
    return {
        **{name: example(kind) for name, kind in MEASURES.items()},
        "POD of a motion": POD(motion),
        "POD of samples": POD(states, about="mean"),
        "PowerSpectrum of a motion": PowerSpectrum(motion, samples=2048),
        "LyapunovSpectrum of a motion": LyapunovSpectrum(motion, iterations=200),
        "CorrelationDimension of a motion": CorrelationDimension(henon),
        "TimeSeries of an array": TimeSeries([0.0, 1.0], [0.0, 0.5]),
        "BifurcationDiagram of a sweep": BifurcationDiagram.of(sweep),
        "Branch": branch,
        "BifurcationCurve": dynkit.continue_curve(doubling, ("a", "b"), bounds=bounds, points=5),
        "Network": dynkit.explore(
            Logistic(rate=2.9), "rate", (2.5, 3.4), iterates=1, seeds=[branch.orbit(0)], values=2
        ),
        "Sweep": sweep,
        "ParameterMap": dynkit.parameter_map(Henon(), plane, start=[0.1, 0.1], progress=False),
        "Basins": dynkit.basins(Logistic(rate=3.2), [[-0.1], [0.3]], progress=False),
        "MapAttractor": henon,
        "MapOrbit": orbit,
        "MapOrbit of a flow": dynkit.periodic_orbit(flow, [0.1, 0.1]),
        "OrbitSearch": dynkit.find_orbits(Henon(), 4, box),
        "OrbitSearch without orbits": dynkit.find_orbits(Henon(), 1, [(9.0, 9.1), (9.0, 9.1)]),
        "OrbitSearch of a machine": chain.find_orbits(impacts=1, periods=2),
        "Equilibrium": dynkit.equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0]),
        "FamilySolution": rest(),
        "ImpactAttractor": motion,
        "ImpactAttractor of several elements": several.attractor(transient=50, impacts=30),
        "ImpactOrbit": chain.periodic_orbit(impacts=1, periods=1),
        "ImpactOrbit of several elements": several.periodic_orbit(),
        "ImpactOrbit that sticks": ImpactChain(
            masses=1, frequency=0.408, restitution=0.3
        ).periodic_orbit(sticking=True),
        "ImpactRecord": motion.record,
        "ImpactRecord by Taylor's method": smooth,
        "CorrelationSums": CorrelationDimension(states).sums,
        "Criticality": doubling.criticality,
        "EnergyBalance": motion.record.energy_balance(),
        "SecondMoments": motion.second_moments(),
        "Harmonics": PowerSpectrum(motion, samples=2048).lines,
        "Modes": chain.modes,
    }


def loaded_from(path: Path, result: Any) -> Any:
    """The result in a store, with its system at other values of its parameters."""
    kind: Any = type(result)
    if not issubclass(kind, SavedWithSystem):
        return kind.load(path)
    system: Any = result.system
    name = next(name for name, value in system.parameters.items() if value)
    other = system.replace(**{name: 1.001 * system.value_of(name)})
    given = BalanceProblem(other) if isinstance(system, Balance) else other
    return type(result).load(path, given)


NAMES = (
    *(*MEASURES, "POD of a motion", "POD of samples", "PowerSpectrum of a motion"),
    *("LyapunovSpectrum of a motion", "CorrelationDimension of a motion", "TimeSeries of an array"),
    *("BifurcationDiagram of a sweep", "Branch", "BifurcationCurve", "Network", "Sweep"),
    *("ParameterMap", "Basins", "MapAttractor", "MapOrbit", "MapOrbit of a flow", "OrbitSearch"),
    *("OrbitSearch without orbits", "OrbitSearch of a machine", "Equilibrium", "FamilySolution"),
    *("ImpactAttractor", "ImpactAttractor of several elements", "ImpactOrbit"),
    *("ImpactOrbit of several elements", "ImpactOrbit that sticks", "ImpactRecord"),
    *(
        "ImpactRecord by Taylor's method",
        "CorrelationSums",
        "Criticality",
        "EnergyBalance",
        "SecondMoments",
        "Harmonics",
        "Modes",
    ),
)
EACH = pytest.mark.parametrize("name", NAMES)


def same(a: Any, b: Any) -> bool:
    """Whether two values have the same bits."""
    if isinstance(a, np.ndarray):
        return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b or (a != a and b != b))


@EACH
def test_what_is_loaded_has_the_same_bits(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    result = results[name]
    before = result.dataset()
    result.save(tmp_path / "x.h5")
    loaded = loaded_from(tmp_path / "x.h5", result)
    after = loaded.dataset()
    # what is made of orbits is there where an orbit is given
    kept = after.arrays()
    assert kept
    assert same({key: before.arrays()[key] for key in kept}, kept)
    of_system = ("system", "parameter_")
    known = isinstance(result, SavedWithSystem)
    expected = {k: v for k, v in before.attributes.items() if known or not k.startswith(of_system)}
    assert same(expected, dict(after.attributes))
    if "label" in vars(result) and known:
        assert loaded.label == result.label  # decided anew
    assert repr(loaded) == repr(result)
    if name != "Sweep":  # which simulates: its system must be given
        assert same(np.asarray(loaded.error), np.asarray(result.error))


@EACH
def test_what_was_loaded_is_saved_again_or_says_what_is_missing(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    result = results[name]
    result.save(tmp_path / "x.h5")
    loaded = loaded_from(tmp_path / "x.h5", result)
    if name in ("Branch", "BifurcationCurve", "Network", "Sweep", "ParameterMap", "Basins"):
        with pytest.raises(ValueError, match=r"(orbit|system) must be given"):
            loaded.save(tmp_path / "y.h5")
        assert not (tmp_path / "y.h5").exists()
        return
    loaded.save(tmp_path / "y.h5")
    again = loaded_from(tmp_path / "y.h5", result)
    assert same(again.dataset().arrays(), result.dataset().arrays())
    if name != "POD of samples" and hasattr(loaded, "plot"):
        assert loaded.plot() is not None
        plt.close("all")


def test_every_public_result_is_exported_and_saved(results: dict[str, Any]) -> None:
    """What has a cost and an error is a result, but for columns and parts of results."""
    met = public_classes()
    said = {"cost", "error"}
    kinds = [kind for kind in met if said <= {*dir(kind), *inspect.get_annotations(kind)}]
    others = {kind for kind in kinds if not issubclass(kind, Result)}
    assert others == {OrbitLabel, Bifurcation, Root}
    final = {kind for kind in met if issubclass(kind, Result) and hasattr(kind, "__final__")}
    assert {type(result) for result in results.values()} == {*final, FamilySolution}
    assert all(hasattr(kind, "save") and hasattr(kind, "load") for kind in final)


def test_what_is_exported_are_the_states(results: dict[str, Any], tmp_path: Path) -> None:
    for name in ("MapAttractor", "MapOrbit"):
        results[name].export(tmp_path / "x.npz")
        with np.load(tmp_path / "x.npz") as stored:
            rows = np.stack([stored["state[0]"], stored["state[1]"]], axis=1)
            assert same(rows, results[name].states)
    search = results["OrbitSearch"]
    search.export(tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        for i, orbit in enumerate(search):
            n = len(orbit.states)
            assert file["period"][i] == n
            assert same(file["state[1]"][i, :n], orbit.states[:, 1])
            assert np.isnan(file["state[1]"][i, n:]).all()
            assert same(file["multiplier"][i], orbit.multipliers)
    rows = search.dataset().columns()["state[0]"]
    assert len(rows) == sum(len(orbit.states) for orbit in search)


@pytest.mark.parametrize("name", NAMES)
def test_every_result_is_exported_in_every_form(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    data = results[name].dataset()
    results[name].export(tmp_path / "x.npz")
    results[name].export(tmp_path / "x.h5")
    results[name].export(tmp_path / "x.csv")
    with np.load(tmp_path / "x.npz") as stored:
        assert all(same(stored[key], array) for key, array in data.arrays().items())
        assert {str(stored["title"]), str(stored["dynkit_version"])} == {
            data.attributes["title"],
            dynkit.__version__,
        }
    with h5py.File(tmp_path / "x.h5") as file:
        assert set(file) == set(data.arrays())
        assert file.attrs["title"] == data.attributes["title"]
    rows = list(csv.reader((tmp_path / "x.csv").read_text().splitlines()))
    table = data.columns()
    assert rows[0] == list(table)
    assert len(rows) == 1 + len(next(iter(table.values())))
    frame = results[name].to_pandas()
    assert list(frame.columns) == list(table)


def test_floats_of_a_table_read_back_bit_for_bit(results: dict[str, Any]) -> None:
    data = results["Branch"].dataset()
    lines = data.as_csv().splitlines()
    assert [float(line.split(",")[0]) for line in lines[1:]] == data.arrays()["rate"].tolist()


def test_a_table_repeats_what_belongs_to_a_value_and_leaves_out_what_is_nan() -> None:
    data = Dataset(
        {"p": ("p", [1.0, 2.0])},
        {"x": (("p", "state"), [[1.0, 2.0], [3.0, np.nan]]), "count": ("p", [2, 1])},
        {},
    )
    assert data.as_csv() == "p,state,x,count\n1.0,0,1.0,2\n1.0,1,2.0,2\n2.0,0,3.0,1\n"


def test_other_dimensions_become_columns() -> None:
    data = Dataset({}, {"x": ("k", [1.0, 2.0]), "z": (("k", "m"), [[1j, 2.0], [3.0, 4.0]])}, {})
    assert list(data.columns()) == [
        *("x", "z_real[0]", "z_real[1]", "z_imaginary[0]", "z_imaginary[1]"),
    ]


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"x": (("k", "m"), [1.0])}, r"x must have the dimensions k, m; got shape \(1,\)"),
        ({"x": ("k", [1.0]), "y": ("k", [1.0, 2.0])}, "y must have length 1 along k; got 2"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(variables: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Dataset({}, variables, {})


def test_another_ending_is_refused(results: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"path must end in .csv, .npz, .h5; got .*x.txt"):
        results["POD"].export(tmp_path / "x.txt")
    assert not list(tmp_path.iterdir())


def changed(path: Path, target: Path, name: str, array: Array) -> None:
    archive = dynkit.data.store.read(path)
    arrays = {**archive.arrays, name: array}
    dynkit.data.store.write(target, dynkit.data.store.Archive(archive.entries, arrays))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 3)), "displacement must have length .* along time; got 2"),
        (np.zeros((2, 3), dtype=np.int64), "displacements is int64"),
        (np.zeros(3), "displacement must have the dimensions"),
    ],
)
def test_arrays_made_by_hand_are_refused(
    array: Array, message: str, results: dict[str, Any], tmp_path: Path
) -> None:
    results["SpaceTime"].save(tmp_path / "x.h5")
    changed(tmp_path / "x.h5", tmp_path / "y.h5", "displacements", array)
    with pytest.raises(ValueError, match=message):
        SpaceTime.load(tmp_path / "y.h5")


def test_a_huge_shape_that_holds_nothing_is_refused_before_memory_is_asked_for(
    tmp_path: Path,
) -> None:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        file.attrs["kind"] = "SpaceTime"
        file.create_dataset("displacements", (1 << 40, 100), dtype="f8", chunks=(1, 100))
    data = buffer.getbuffer()[512:]
    (tmp_path / "x.h5").write_bytes(bytes(dynkit.data.store._heading(data)) + bytes(data))
    with pytest.raises(
        ValueError, match=r"'displacements' has shape \(1099511627776, 100\) but not all its data"
    ):
        SpaceTime.load(tmp_path / "x.h5")


def test_the_store_of_another_result_is_refused(results: dict[str, Any], tmp_path: Path) -> None:
    results["POD"].save(tmp_path / "x.h5")
    with pytest.raises(
        ValueError, match=r"^store must hold a SpaceTime; got .*x.h5, which holds: POD$"
    ):
        SpaceTime.load(tmp_path / "x.h5")


BRANCHES = {
    "MapOrbit": ("a", (0.1, 1.0)),
    "MapOrbit of a flow": ("force", (0.45, 0.5)),
    "Equilibrium": ("rho", (14.0, 16.0)),
    "FamilySolution": ("force", (0.5, 1.5)),
    "ImpactOrbit": ("frequency", (0.88, 0.92)),
    "ImpactOrbit of several elements": ("belt.force", (0.01, 0.02)),
    "ImpactOrbit that sticks": ("frequency", (0.4, 0.41)),
}


@pytest.mark.parametrize("name", BRANCHES)
def test_what_is_loaded_is_continued_as_what_was_saved(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    orbit, (parameter, bounds) = results[name], BRANCHES[name]
    orbit.save(tmp_path / "x.h5")
    loaded = loaded_from(tmp_path / "x.h5", orbit)
    for x in ("multipliers", "multipliers_error", "eigenvalues", "eigenvalues_error"):
        assert same(np.asarray(getattr(orbit, x, 0.0)), np.asarray(getattr(loaded, x, 0.0)))
    branches = [dynkit.continue_orbit(o, parameter, bounds=bounds) for o in (orbit, loaded)]
    assert len(branches[0]) > 2
    assert same(*(branch.dataset().arrays() for branch in branches))


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("Impact")])
def test_motions_of_machines_that_are_loaded_are_those_that_were_saved(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    result = results[name]
    result.save(tmp_path / "x.h5")
    loaded = loaded_from(tmp_path / "x.h5", result)
    if hasattr(result, "sample"):
        times = np.linspace(0.0, result.time[-1], 50)
        assert same(np.array(result.sample(times)), np.array(loaded.sample(times)))
    if "Attractor" in name:
        times = np.linspace(0.0, 2.0 * result.duration, 50)
        assert same(result.time_series(times), loaded.time_series(times))
        assert loaded.label == result.label
        assert same(loaded.periodic_orbit().states, result.periodic_orbit().states)
    if "Record" in name:
        assert same(vars(loaded.events), vars(result.events))
        balances = [record.energy_balance() for record in (loaded, result)]
        assert balances[0].error == balances[1].error
        assert loaded.final._numbers[:4] == result.final._numbers[:4]


def of_several_elements(record: Any) -> list[Any]:
    """What depends on the modes of the motion."""
    times = np.linspace(0.0, record.time[-1], 200)
    orbit = record.as_attractor().periodic_orbit()
    names = record.system.observables
    seen = [record.observable(name, times) for name in names if "." in name and "imp" not in name]
    return [record.events.velocity, record.error, *record.sample(times), *seen, orbit.states]


def test_a_record_is_loaded_with_a_machine_whose_modes_were_entered_in_another_order(
    tmp_path: Path,
) -> None:
    record = machine().simulate(impacts=300)
    record.save(tmp_path / "x.h5")
    other = entered()
    loaded = ImpactRecord.load(tmp_path / "x.h5", other)
    assert loaded.system is other
    assert loaded._run.regimes != record._run.regimes
    pairs = zip(of_several_elements(record), of_several_elements(loaded), strict=True)
    assert all(same(a, b) for a, b in pairs)


REFUSED_SYSTEMS = {
    "another class": ("MapOrbit", Logistic(), "made with system .*Henon; got .*Logistic"),
    "another structure": (
        "ImpactRecord",
        ImpactChain(masses=3, frequency=0.9),
        r"made with (masses 2|.* array \(2, 2\) .*); got",
    ),
    "no system": ("MapAttractor", 3.0, "system must be a Map or a Flow; got 3.0"),
    "no problem": ("FamilySolution", Balance(), "problem must be a FamilyProblem; got Balance"),
    "another section": (
        "MapOrbit of a flow",
        dynkit.PoincareMap(Duffing(), dynkit.Stroboscope(3, phase=1.0), 10.0),
        r"made with section Stroboscope\(.*_phase=0.0.*\); got Stroboscope\(.*_phase=1.0",
    ),
}


@pytest.mark.parametrize("case", REFUSED_SYSTEMS)
def test_another_system_is_refused_by_name(
    case: str, results: dict[str, Any], tmp_path: Path
) -> None:
    name, system, message = REFUSED_SYSTEMS[case]
    results[name].save(tmp_path / "x.h5")
    with pytest.raises(ValueError, match=message):
        type(results[name]).load(tmp_path / "x.h5", system)


def test_every_measure_is_saved() -> None:
    measures = [getattr(analysis, name) for name in dir(analysis)]
    classes = [kind for kind in measures if inspect.isclass(kind) and hasattr(kind, "plot")]
    assert classes
    assert not {kind for kind in classes if not issubclass(kind, Saved)}
