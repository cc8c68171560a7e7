"""Every result that is saved is read again with the same bits, and shows and draws the same."""

from __future__ import annotations

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
from dynkit import analysis
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
from dynkit.data.result import Result, Saved
from dynkit.labels.label import OrbitLabel
from dynkit.systems import Henon, ImpactChain, Logistic, Rossler
from tests.public_classes import example, measures, public_classes

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
    }


NAMES = (
    *(*MEASURES, "POD of a motion", "POD of samples", "PowerSpectrum of a motion"),
    *("LyapunovSpectrum of a motion", "CorrelationDimension of a motion", "TimeSeries of an array"),
    *("BifurcationDiagram of a sweep", "Branch", "BifurcationCurve", "Network", "Sweep"),
    *("ParameterMap", "Basins"),
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
    loaded = type(result).load(tmp_path / "x.h5")
    after = loaded.dataset()
    # what is made of orbits is there where an orbit is given
    kept = after.arrays()
    assert kept
    assert same({key: before.arrays()[key] for key in kept}, kept)
    of_system = ("system", "parameter_")
    expected = {k: v for k, v in before.attributes.items() if not k.startswith(of_system)}
    assert same(expected, dict(after.attributes))
    assert repr(loaded) == repr(result)
    if name != "Sweep":  # which simulates: its system must be given
        assert same(np.asarray(loaded.error), np.asarray(result.error))


@EACH
def test_what_was_loaded_is_saved_again_or_says_what_is_missing(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    result = results[name]
    result.save(tmp_path / "x.h5")
    loaded = type(result).load(tmp_path / "x.h5")
    if name in ("Branch", "BifurcationCurve", "Network", "Sweep", "ParameterMap", "Basins"):
        with pytest.raises(ValueError, match=r"(orbit|system) must be given"):
            loaded.save(tmp_path / "y.h5")
        assert not (tmp_path / "y.h5").exists()
        return
    loaded.save(tmp_path / "y.h5")
    again = type(result).load(tmp_path / "y.h5")
    assert same(again.dataset().arrays(), result.dataset().arrays())
    if name != "POD of samples":
        assert loaded.plot() is not None
        plt.close("all")


@pytest.fixture(scope="module")
def exported(results: dict[str, Any]) -> dict[str, Any]:
    """Results that are saved, and those that are only exported."""
    henon, chain = Henon(), ImpactChain(masses=2, frequency=0.9)
    motion, orbit = chain.attractor(transient=100, impacts=60), dynkit.periodic_orbit(henon, [1, 0])
    box = [(-2.0, 2.0), (-2.0, 2.0)]
    return {
        **results,
        "MapAttractor": henon.attractor(start=[0.1, 0.1], transient=9, keep=7),
        "MapOrbit": orbit,
        "OrbitSearch": dynkit.find_orbits(henon, 4, box),
        "OrbitSearch without orbits": dynkit.find_orbits(henon, 1, [(9.0, 9.1), (9.0, 9.1)]),
        "Equilibrium": dynkit.equilibrium(Rossler(), [0.0, 0.0, 0.0]),
        "ImpactAttractor": motion,
        "ImpactOrbit": chain.periodic_orbit(impacts=1, periods=1),
        "ImpactRecord": motion.record,
    }


ONLY_EXPORTED = (
    *("MapAttractor", "MapOrbit", "OrbitSearch", "OrbitSearch without orbits", "Equilibrium"),
    *("ImpactAttractor", "ImpactOrbit", "ImpactRecord"),
)


def test_every_public_result_is_exported(exported: dict[str, Any]) -> None:
    """What has a cost and an error is a result, but for labels, which are columns of results."""
    met = public_classes()
    kinds = [kind for kind in met if hasattr(kind, "error") and hasattr(kind, "cost")]
    assert [kind for kind in kinds if not issubclass(kind, Result)] == [OrbitLabel]
    final = {kind for kind in met if issubclass(kind, Result) and hasattr(kind, "__final__")}
    assert {type(result) for result in exported.values()} == final


def test_what_is_exported_are_the_states(exported: dict[str, Any], tmp_path: Path) -> None:
    for name in ("MapAttractor", "MapOrbit"):
        exported[name].export(tmp_path / "x.npz")
        with np.load(tmp_path / "x.npz") as stored:
            rows = np.stack([stored["state[0]"], stored["state[1]"]], axis=1)
            assert same(rows, exported[name].states)
    search = exported["OrbitSearch"]
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


@pytest.mark.parametrize("name", [*NAMES, *ONLY_EXPORTED])
def test_every_result_is_exported_in_every_form(
    name: str, exported: dict[str, Any], tmp_path: Path
) -> None:
    results = exported
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
    rows = (tmp_path / "x.csv").read_text().splitlines()
    table = data.columns()
    assert rows[0].split(",") == list(table)
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
    with pytest.raises(ValueError, match=r"^store must hold a SpaceTime; got .*x.h5$"):
        SpaceTime.load(tmp_path / "x.h5")


def test_every_measure_is_saved() -> None:
    measures = [getattr(analysis, name) for name in dir(analysis)]
    classes = [kind for kind in measures if inspect.isclass(kind) and hasattr(kind, "plot")]
    assert classes
    assert not {kind for kind in classes if not issubclass(kind, Saved)}
