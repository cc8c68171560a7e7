"""`dynkit view`: stores with the systems that they describe, and refusals in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dynkit import MapAttractor, continue_orbit, equilibrium, explore, periodic_orbit, sweep
from dynkit.analysis import BifurcationDiagram
from dynkit.cli import main
from dynkit.cli.stored import loaded, value_of
from dynkit.data.store import identity_of
from dynkit.systems import (
    DryFriction,
    HardStop,
    Henon,
    ImpactChain,
    Logistic,
    Lorenz,
    MatrixOscillator,
    PlasticBelow,
    PlayOscillator,
    SingleImpactOscillator,
    SoftStop,
)
from dynkit.viewer import html
from tests.example_systems import CircleRotation
from tests.viewer.pages import CHAIN, branch, branch_of_impacts, curve, grid, plane, swept

BELT = DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt")
MACHINES = {
    "chain": CHAIN,
    "single": SingleImpactOscillator(frequency=2.6, stop=0.1),
    "play": PlayOscillator(frequency=1.0),
    "law": ImpactChain(masses=2, frequency=0.9, restitution=PlasticBelow(0.8, 0.1)),
    "belt": ImpactChain(masses=2, frequency=0.9, elements=[BELT]),
    "three lines": ImpactChain(
        masses=3,
        frequency=0.9,
        elements=[HardStop((0, 1), offset=-0.2, restitution=0.5), SoftStop(2, stiffness=20.0)],
    ),
    "forces with phases": ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0.3 - 0.2j, 1e-5j]),
    "a force with a phase": ImpactChain(masses=1, frequency=0.9, harmonic_forces=[0.3 + 0.1j]),
    "matrices": MatrixOscillator(
        M=np.eye(2), C=0.1 * np.eye(2), K=[[2.0, -1.0], [-1.0, 2.0]], frequency=1.0
    ),
}


MOTIONS: dict[str, Any] = {
    "attractor": CHAIN.attractor,
    "record": lambda: CHAIN.simulate(impacts=30),
    "orbit": lambda: CHAIN.periodic_orbit(impacts=1, periods=3),
    "map": lambda: Henon().attractor(start=[0.1, 0.1], keep=50),
    "one coordinate": lambda: Logistic(rate=3.2).attractor(start=[0.3], keep=50),
    "orbit of a map": lambda: periodic_orbit(Henon(), [0.6, 0.2]),
}


@pytest.mark.parametrize("name", MACHINES)
def test_the_system_of_a_store_is_made_again(name: str, tmp_path: Path) -> None:
    system: Any = MACHINES[name]
    store = tmp_path / "x.h5"
    found = sweep(system, "frequency", [0.9], transient=5, keep=3, progress=False, store=store)
    again = loaded(str(store))
    assert identity_of(again.attractor(0).system) == identity_of(found.attractor(0).system)
    np.testing.assert_array_equal(again.attractor(0).states, found.attractor(0).states)


@pytest.mark.parametrize("make", [swept, plane, branch, branch_of_impacts, curve, grid])
@pytest.mark.parametrize("motions", [3, 200])
def test_the_command_writes_the_page_of_a_store(
    make: Any, motions: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, out = tmp_path / "x.h5", tmp_path / "x.html"
    make().save(store)
    given = ["view", str(store), "--out", str(out), "--no-show", "--motions", str(motions)]
    assert main(given) == 0
    page = make().view(motions=motions, show=False)
    assert len(page.series) > 0
    assert capsys.readouterr().out.splitlines() == [
        f"shown        {page.title}",
        f"points       {len(page.look)}",
        f"time series  {len(page.series)}",
        f"written      {out}",
        *page.notes,
    ]
    if motions == 200:  # otherwise the result may know more labels than the store
        assert out.read_text(encoding="utf-8") == page.html()


def test_a_network_of_impacts_finds_its_orbits_again(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    explore(CHAIN, "frequency", (0.86, 0.92), iterates=1, periods=2).save(store)
    found = loaded(str(store))
    assert len(found.branches) >= 2
    assert len(found.view(motions=5, show=False).series) == 5


def test_equilibria_are_found_again(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    start = equilibrium(Lorenz(rho=5.0), [3.0, 3.0, 4.0])
    continue_orbit(start, "rho", bounds=(4.0, 6.0)).save(store)
    assert loaded(str(store)).orbit(0).label == "equilibrium"


def test_a_system_of_ones_own_has_a_diagram_without_motions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Mine(Logistic):
        """A map that no store can make again."""

    store, out = tmp_path / "x.h5", tmp_path / "x.html"
    sweep(Mine(rate=3.2), "rate", [3.2], start=[0.3], progress=False, store=store)
    assert main(["view", str(store), "--out", str(out), "--no-show"]) == 0
    said = capsys.readouterr().out
    assert "time series  0\n" in said
    assert "The result was loaded without its system: the page has no time series." in said


def test_another_definition_of_the_same_name_is_not_used(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    swept().save(store)
    whole = loaded(str(store))
    assert whole.attractor(0).label.name == swept().label(0).name
    others = (
        ("system.stiffness", "(" * 100_000),
        ("system.stiffness", "other"),
        ("system.masses", "3"),
        ("system", "os.path"),
    )
    for key, text in others:
        rewritten(store, key, text)
        with pytest.raises(ValueError, match="system must be given"):
            loaded(str(store)).attractor(0)
        swept().save(store)


def rewritten(store: Path, key: str, text: str) -> None:
    """Change an entry of a store, with a valid checksum."""
    from dynkit.data import store as stores

    archive = stores.read(store)
    stores.write(store, stores.Archive({**archive.entries, key: text}, archive.arrays))


@pytest.mark.parametrize(
    "text",
    ["", "(", "(1", "1 2", "eval('1')", "HardStop", "HardStop(2", "__import__('os')", "1.0.0", ")"],
)
def test_other_texts_are_no_values(text: str) -> None:
    with pytest.raises(ValueError, match=r"must|could not convert"):
        value_of(text)


# --- wrong input ----------------------------------------------------------------------------------


def refused(capsys: pytest.CaptureFixture[str], *given: str) -> str:
    assert main(["view", *given]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_wrong_input_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, out = tmp_path / "x.h5", tmp_path / "x.html"
    swept().save(store)
    assert "required: RESULTS.h5" in refused(capsys)
    assert "must be a file that can be read" in refused(capsys, str(tmp_path / "no.h5"))
    assert "store must be a file" in refused(capsys, str(tmp_path))
    text = tmp_path / "text.h5"
    text.write_text("hello")
    assert "store must be a store of dynkit" in refused(capsys, str(text))
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = [1.0]
    assert "store must be a store of dynkit" in refused(capsys, str(tmp_path / "other.h5"))
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(store.read_bytes()[:-10])
    assert "truncated or damaged" in refused(capsys, str(damaged))
    assert "out must end in .html" in refused(capsys, str(store), "--out", "x.pdf")
    assert "motions must be" in refused(capsys, str(store), "--motions", "-3")
    assert "there is no argument --wide" in refused(capsys, str(store), "--wide")
    assert not out.exists()


def test_other_kinds_of_results_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "x.h5"
    BifurcationDiagram.of(swept()).save(store)
    said = refused(capsys, str(store))
    assert "basins, an attractor, a record or an orbit; got BifurcationDiagram" in said


@pytest.mark.parametrize("name", MOTIONS)
def test_the_page_of_a_stored_motion_is_that_of_the_motion(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, out = tmp_path / "x.h5", tmp_path / "x.html"
    MOTIONS[name]().save(store)
    assert main(["view", str(store), "--out", str(out), "--no-show"]) == 0
    assert "time series  1\n" in capsys.readouterr().out
    assert out.read_text(encoding="utf-8") == MOTIONS[name]().view(show=False).html()


def test_a_motion_of_a_system_of_the_user_says_how_it_is_viewed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "x.h5"
    MapAttractor(CircleRotation(0.3), np.array([1.0, 0.0]), 5, 20).save(store)
    said = refused(capsys, str(store))
    assert "got one of tests.example_systems.CircleRotation: in Python, load it" in said
    assert "MapAttractor.load, and call its method view" in said


def test_a_simulated_motion_is_viewed(tmp_path: Path) -> None:
    store, out = str(tmp_path / "x.h5"), tmp_path / "x.html"
    chain = ["--masses", "2", "--frequency", "0.87"]
    assert main(["simulate", *chain, "--impacts", "20", "--store", store]) == 0
    assert main(["view", store, "--out", str(out), "--no-show"]) == 0
    assert out.exists()


def test_a_huge_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    huge = tmp_path / "huge.h5"
    with huge.open("wb") as file:
        file.truncate(3_000_000_000)  # a hole: it takes no room
    assert "results must be at most 2 GB; got 3.0 GB" in refused(capsys, str(huge))


def test_the_command_names_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "find_spec", lambda _: None)
    assert "pip install 'dynkit[view]'" in refused(capsys, str(tmp_path / "x.h5"))


def test_the_command_opens_the_browser(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: str(tmp_path))
    branch().save(tmp_path / "x.h5")
    assert main(["view", str(tmp_path / "x.h5"), "--motions", "0"]) == 0
    assert opened == [(tmp_path / "view.html").as_uri()]
    assert str(tmp_path / "view.html") in capsys.readouterr().out
