"""Files that are no stores, are damaged, or were made by hand: refused by name, whoever reads them.

Each byte and each length of one store are tried in tests/data/test_store.py; here are all readers.
"""

import json
import os
import re
import socket
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import dynkit
from dynkit import Basins, BifurcationCurve, Branch, Network, ParameterMap, Sweep
from dynkit.data import store
from dynkit.data.store import Archive
from dynkit.systems import Henon, ImpactChain, Logistic, Lorenz
from tests.data.machines import machine
from tests.testing.test_problems import Balance, BalanceProblem, rest

RATES = np.linspace(3.4, 3.9, 6)
ORBIT = dynkit.periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
FIXED = dynkit.periodic_orbit(Logistic(rate=2.5), [0.6])
MACHINE = machine()
ATTRACTOR = ImpactChain(masses=2, frequency=0.9).attractor(transient=50, impacts=9)
RESULTS: dict[str, Any] = {
    "MapAttractor": Henon().attractor(start=[0.1, 0.1], transient=9, keep=7),
    "MapOrbit": ORBIT,
    "OrbitSearch": dynkit.find_orbits(Henon(), 2, [(-2.0, 2.0), (-2.0, 2.0)]),
    "Equilibrium": dynkit.equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0]),
    "FamilySolution": rest(),
    "ImpactRecord": ATTRACTOR.record,
    "ImpactAttractor": ATTRACTOR,
    "ImpactOrbit": MACHINE.periodic_orbit(),
}
"""Results that are loaded with their systems."""


def resumed(path: Path | None, **changed: Any) -> Sweep:
    arguments: dict[str, Any] = {"start": [0.3], "transient": 5, "keep": 4, "progress": False}
    return dynkit.sweep(Logistic(rate=3.5), "rate", RATES, store=path, **arguments, **changed)


def mapped(path: Path) -> ParameterMap:
    values = {"a": [0.2, 1.0], "b": [0.2, 0.3]}
    arguments: dict[str, Any] = {"start": [0.1, 0.1], "transient": 5, "keep": 4, "progress": False}
    return dynkit.parameter_map(Henon(), values, store=path, **arguments)


def attracted(path: Path) -> Basins:
    starts = [[0.1, 0.1], [0.2, 0.1]]
    return dynkit.basins(Henon(a=1.0), starts, transient=5, keep=9, store=path, progress=False)


HELD = {
    "sweep": "a sweep",
    "independent": "a sweep",
    "plane": "a map of two parameters",
    "basins": "a (basins of attraction|Basins)",
    "branch": "a Branch",
    "curve": "a BifurcationCurve",
    "network": "a Network",
    **{name: f"an? {name}" for name in RESULTS},
}
"""What a refusal says that a store of each kind must hold."""


def _reader(result: Any) -> Callable[[Path], Any]:
    system = result.system
    given = BalanceProblem(system) if isinstance(system, Balance) else system
    return lambda path: type(result).load(path, given)


READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "sweep": ("sweep", resumed),
    "Sweep.load": ("sweep", Sweep.load),
    "Sweep.load, system": ("sweep", partial(Sweep.load, system=Logistic(rate=1.0))),
    "independent sweep": ("independent", partial(resumed, follow=False)),
    "Sweep.load of it": ("independent", Sweep.load),
    "plane": ("plane", mapped),
    "ParameterMap.load": ("plane", ParameterMap.load),
    "basins": ("basins", attracted),
    "Basins.load": ("basins", Basins.load),
    "Branch.load": ("branch", Branch.load),
    "Branch.load, orbit": ("branch", partial(Branch.load, orbit=ORBIT)),
    "BifurcationCurve.load": ("curve", BifurcationCurve.load),
    "BifurcationCurve.load, orbit": ("curve", partial(BifurcationCurve.load, orbit=ORBIT)),
    "Network.load": ("network", Network.load),
    "Network.load, orbits": ("network", partial(Network.load, orbits=[FIXED])),
    **{f"{name}.load, system": (name, _reader(found)) for name, found in RESULTS.items()},
}
EACH_READER = pytest.mark.parametrize("reader", READERS)
# Those that need most of what is stored.
EACH_FULL_READER = pytest.mark.parametrize(
    "reader", [name for name in READERS if ", " in name or name == "sweep"]
)
NOT_NEEDED = {
    "sweep": ("dynkit",),
    "Sweep": ("dynkit",),
    "Branch": ("dynkit", "system"),
    "BifurcationCurve": ("dynkit", "system"),
    "Network": ("dynkit", "system"),
    **dict.fromkeys(RESULTS, ("dynkit",)),
}


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Archive]:
    """A store of each kind."""
    folder = tmp_path_factory.mktemp("stores")
    resumed(folder / "sweep")
    resumed(folder / "independent", follow=False)
    mapped(folder / "plane")
    attracted(folder / "basins")
    branch = dynkit.continue_orbit(ORBIT, "a", bounds=(0.1, 1.4))
    branch.save(folder / "branch")
    names, bounds = ("a", "b"), ((0.0, 3.0), (-0.9, 0.9))
    dynkit.continue_curve(branch.bifurcations[0], names, bounds=bounds).save(folder / "curve")
    first = dynkit.continue_orbit(FIXED, "rate", bounds=(2.0, 3.3))
    dynkit.explore(
        Logistic(rate=2.9), "rate", (2.0, 3.3), iterates=1, seeds=[first.orbit(0)], values=2
    ).save(folder / "network")
    for name, result in RESULTS.items():
        result.save(folder / name)
    return {kind: store.read(folder / kind) for kind in HELD}


def refusal(reader: str, path: Path) -> str:
    """What a reader says of a file; it must refuse it, and leave it as it is."""
    before = path.read_bytes() if path.is_file() else b""
    with pytest.raises(ValueError, match="store") as error:
        READERS[reader][1](path)
    assert (path.read_bytes() if path.is_file() else b"") == before
    assert str(path) in str(error.value)
    return str(error.value)


def hdf5(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["values"] = [1.0]


def _link_to_text(path: Path) -> None:
    path.with_name("mine.txt").write_text("mine")
    path.symlink_to("mine.txt")


FOREIGN: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (Path.touch, "must be a store of dynkit, as store="),
    "text": (lambda path: path.write_text("mine\n" * 300), "must be a store of dynkit, as store="),
    "HDF5": (hdf5, "must be a store of dynkit, as store="),
    "folder": (Path.mkdir, "must be a file;"),
    "pipe": (os.mkfifo, "must be a file;"),
    "socket": (lambda path: socket.socket(socket.AF_UNIX).bind("x.h5"), "must be a file;"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "must be a file;"),
    "loop of links": (lambda path: path.symlink_to(path), "must be a file;"),
    "link to text": (_link_to_text, "must be a store of dynkit, as store="),
}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    yield tmp_path / "x.h5"
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


@EACH_READER
@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the socket is left to itself
def test_what_is_no_store_is_refused(reader: str, kind: str, place: Path) -> None:
    make, message = FOREIGN[kind]
    make(place)
    given = place if kind != "link to text" else place.resolve()
    if given != place:
        with pytest.raises(ValueError, match=f"store {message}.*; got .*mine.txt"):
            READERS[reader][1](place)
    else:
        assert f"store {message}" in refusal(reader, place)


@EACH_READER
def test_damage_anywhere_is_refused(reader: str, place: Path, archives: dict[str, Archive]) -> None:
    store.write(place, archives[READERS[reader][0]])
    whole, random = place.read_bytes(), np.random.default_rng(20261122)
    for length in random.integers(len(whole), size=40).tolist():
        place.write_bytes(whole[:length])
        assert "whole" in refusal(reader, place) or length < 21
    for byte, bit in random.integers((len(whole), 8), size=(200, 2)).tolist():
        damaged = bytearray(whole)
        damaged[byte] ^= 1 << bit
        place.write_bytes(damaged)
        refusal(reader, place)


@EACH_READER
def test_a_store_of_another_kind_is_refused(
    reader: str, place: Path, archives: dict[str, Archive]
) -> None:
    for archive in archives.values():
        # a sweep that does not follow has the same form as one that does
        if archive.entries["kind"] != archives[READERS[reader][0]].entries["kind"]:
            store.write(place, archive)
            held = HELD[READERS[reader][0]]
            assert re.search(f"store must hold {held}; got ", refusal(reader, place))


def used(reader: str, path: Path) -> bool:
    """Whether a file is read; then what was read can be looked at, else its refusal names it."""
    said = ""
    try:
        found = READERS[reader][1](path)
    except ValueError as error:
        said = str(error)
    if said:
        assert "store" in said
        assert str(path) in said
        return False
    assert repr(found)
    if hasattr(found, "__len__") and not reader.startswith(("Network", "OrbitSearch")):
        assert len(found) > 0
    return True


@EACH_FULL_READER
def test_whatever_is_missing_is_named(
    reader: str, place: Path, archives: dict[str, Archive]
) -> None:
    archive = archives[READERS[reader][0]]
    for name in archive.entries:
        rest = {key: text for key, text in archive.entries.items() if key != name}
        store.write(place, Archive(rest, archive.arrays))
        last = name.rpartition(", ")[2]  # of a network's branches
        told_only = last.startswith("system.") or last in NOT_NEEDED[reader.partition(".")[0]]
        assert used(reader, place) <= told_only, name
    for name in archive.arrays:
        others = {key: rows for key, rows in archive.arrays.items() if key != name}
        store.write(place, Archive(archive.entries, others))
        assert not used(reader, place), name


# What must never run, and what does not mean what it should.
TEXTS = [
    "__import__('pathlib').Path('injected').touch()",
    "c__builtin__\neval\n(V__import__('pathlib').Path('injected').touch()\ntR.",
    "!!python/object/apply:os.system ['touch injected']",
    *("", "null", "[]", "5", "-1", '"x"', "9" * 5000, "[" * 50_000),
]


@EACH_FULL_READER
def test_texts_made_by_hand_are_data(
    reader: str, place: Path, archives: dict[str, Archive]
) -> None:
    archive = archives[READERS[reader][0]]
    for name in archive.entries:
        for text in TEXTS:
            store.write(place, Archive({**archive.entries, name: text}, archive.arrays))
            used(reader, place)
            assert not place.with_name("injected").exists(), (name, text)


@EACH_FULL_READER
def test_arrays_made_by_hand_are_refused_or_numbers(
    reader: str, place: Path, archives: dict[str, Archive]
) -> None:
    archive = archives[READERS[reader][0]]
    for name, rows in archive.arrays.items():
        for other in (np.empty(0), rows[:-1], rows[None], np.array([b"x"] * len(rows)), rows + 1j):
            store.write(place, Archive(archive.entries, {**archive.arrays, name: other}))
            used(reader, place)


def places_in(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The places of all values in nested lists and mappings."""
    yield path
    parts: Any = tree.items() if isinstance(tree, dict) else ()
    for key, part in enumerate(tree) if isinstance(tree, list) else parts:
        yield from places_in(part, (*path, key))


BY_HAND = ["Branch.load, orbit", "BifurcationCurve.load, orbit"]
BY_HAND += [
    f"{name}.load, system"
    for name in ("MapAttractor", "MapOrbit", "OrbitSearch", "Equilibrium", "ImpactRecord")
]


@pytest.mark.parametrize("reader", BY_HAND)
def test_values_made_by_hand_are_refused_or_data(
    reader: str, place: Path, archives: dict[str, Archive]
) -> None:
    archive = archives[READERS[reader][0]]
    tree = json.loads(archive.arrays["json"].tobytes())
    refused, paths = 0, list(places_in(tree))[1:]
    for path in paths:
        others: tuple[Any, ...] = (None, [], {}, "../../x", 5, -1, 1e308, [[1.0]])
        for other in others:
            changed = json.loads(json.dumps(tree))
            parent = changed
            for key in path[:-1]:
                parent = parent[key]
            parent[path[-1]] = other
            text = np.frombuffer(json.dumps(changed).encode(), dtype=np.uint8)
            store.write(place, Archive(archive.entries, {**archive.arrays, "json": text}))
            refused += not used(reader, place)
    assert refused > 4 * len(paths)


@EACH_READER
def test_arrays_that_stand_in_other_files_are_not_read(
    reader: str, place: Path, archives: dict[str, Archive], monkeypatch: pytest.MonkeyPatch
) -> None:
    archive = archives[READERS[reader][0]]
    secret = place.with_name("secret")
    secret.write_bytes(bytes(8))
    create = h5py.Group.create_dataset

    def elsewhere(group: h5py.Group, name: str, data: Any) -> Any:
        external = [(str(secret), 0, 8)]
        return create(group, name, shape=(1,), dtype=np.float64, external=external)

    with monkeypatch.context() as forging:
        forging.setattr(h5py.Group, "create_dataset", elsewhere)
        store.write(place, archive)
    assert "store must hold plain arrays and texts" in refusal(reader, place)
