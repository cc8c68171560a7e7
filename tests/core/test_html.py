"""Objects in notebooks: small tables that stand alone, and cost nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import ParameterMap, Sweep, basins, parameter_map, sweep
from dynkit.analysis import BifurcationDiagram, ChatterRatios, LyapunovSpectrum, TimeSeries
from dynkit.core.reprs import table
from dynkit.systems import Henon, ImpactChain, Logistic, Lorenz
from dynkit.systems.impact.records import record as records
from dynkit.systems.structure.lagrangian import LagrangianStructure
from tests.project.test_costs_and_errors import RESULTS

SHOWN: dict[str, Callable[[], Any]] = {
    name: RESULTS[name]
    for name in (
        "Basins",
        "Bifurcation",
        "BifurcationCurve",
        "BifurcationDiagram",
        "Branch",
        "ImpactAttractor",
        "ImpactOrbit",
        "ImpactOrbit, sticking",
        "ImpactRecord",
        "MapAttractor",
        "MapOrbit",
        "Network",
        "ParameterMap",
        "Sweep",
    )
}
SHOWN |= {"chain": lambda: ImpactChain(masses=3, frequency=0.9), "flow": Lorenz}


class Reader(HTMLParser):
    """The tags of a page, their attributes, and the texts of the cells of each row."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: set[str] = set()
        self.tags: set[str] = set()
        self.rows: list[list[str]] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        self.tags.add(tag)
        self.attributes |= {f"{name}={value}" for name, value in attrs}
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1] != "caption":
            self.rows[-1].append(data)

    @property
    def facts(self) -> dict[str, str]:
        return {row[0]: row[1] for row in self.rows if len(row) == 2}


def shown(thing: Any) -> Reader:
    return Reader(thing._repr_html_())


@pytest.mark.parametrize("name", SHOWN)
def test_a_table_is_closed_small_and_has_no_colours_scripts_or_links(name: str) -> None:
    page = SHOWN[name]()._repr_html_()
    found = Reader(page)
    assert not found.open
    assert found.tags == {"table", "caption", "tr", "th", "td"}
    assert found.attributes == {"style=text-align:left"}
    assert 2 <= len(found.rows) <= 60
    assert all(len(cell) < 200 for row in found.rows for cell in row)
    assert len(page) < 12_000


def test_everything_is_escaped_and_long_tables_are_cut() -> None:
    page = table("<b>", [("&", "<script>"), *((i, i) for i in range(99))], ("<th>", '"x"'), most=5)
    assert "<script>" not in page
    assert "<b>" not in page
    found = Reader(page)
    assert found.rows[0] == ["<th>", '"x"']
    assert found.rows[1] == ["&", "<script>"]
    assert found.rows[-1] == ["... 95 more"]


def test_a_chain_shows_its_parameters_and_first_modes() -> None:
    facts = shown(ImpactChain(masses=2, frequency=0.9, damping=0.1)).facts
    assert (facts["frequency"], facts["restitution"]) == ("0.9", "0.85")
    assert facts["degrees of freedom"] == "2"
    # 2 sin(pi / 10), the golden ratio's inverse; proportional damping: half of 0.1 times it
    assert facts["mode 1"] == "natural frequency 0.618034, damping ratio 0.0309"


def test_a_parameter_may_have_the_name_of_a_row() -> None:
    @dataclass(frozen=True)
    class Sensed(ImpactChain):
        error: float = 0.25

    assert shown(Sensed(masses=2, frequency=0.9)).facts["error"] == "0.25"


def test_the_error_of_a_map_leaves_out_where_there_is_no_motion() -> None:
    start, values = [0.1, 0.1], {"a": [0.2, 9.0], "b": [0.3]}
    found = parameter_map(Henon(), values, start=start, progress=False)
    assert "error" not in shown(found).facts
    known, missing = found.error[:, 0]
    assert np.isnan(missing)
    assert shown(found).facts["error"] == f"up to {known:.1e}"


def test_a_free_chain_shows_a_rigid_body() -> None:
    free = ImpactChain(masses=2, springs=(0.0, 1.0), frequency=0.9)
    assert shown(free).facts["mode 1"] == "natural frequency 0, a rigid body"


def test_modes_of_large_structures_are_shown_once_they_are_known() -> None:
    large = ImpactChain(masses=101, frequency=0.9)
    assert "mode 1" not in shown(large).facts
    assert large.modes.frequencies[0] > 0.0
    assert "mode 1" in shown(large).facts


def test_energies_that_are_refused_are_shown_as_such() -> None:
    class Sinking(LagrangianStructure):
        degrees_of_freedom = 1

        def kinetic(self, v: Any) -> Any:
            return v[0] ** 2 / 2

        def potential(self, x: Any) -> Any:
            return -(x[0] ** 2)

    assert "potential" in shown(Sinking()).facts["modes"]


@pytest.fixture
def _nothing_is_simulated(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a table must not simulate")

    with monkeypatch.context() as patch:
        patch.setattr(records, "course_from", refuse)
        patch.setattr(Sweep, "attractor", refuse)
        patch.setattr(ParameterMap, "attractor", refuse)
        yield


@pytest.mark.usefixtures("_nothing_is_simulated")
def test_errors_and_labels_that_must_be_simulated_are_not_shown() -> None:
    chain = ImpactChain(masses=2, frequency=0.9)
    attractor = chain.attractor(transient=5, impacts=5)
    assert "error" not in shown(attractor.record).facts
    assert shown(attractor).facts["label"] == "not decided yet"
    shown(RESULTS["Sweep"]())
    shown(RESULTS["ParameterMap"]())


def test_errors_and_labels_are_shown_once_they_are_known() -> None:
    attractor = ImpactChain(masses=2, frequency=0.9).attractor(impacts=20)
    label, error = str(attractor.label), attractor.record.error.max()
    assert shown(attractor).facts["label"] == label
    assert shown(attractor.record).facts["error"] == f"up to {error:.1e}"
    swept = RESULTS["Sweep"]()
    label = str(swept.label(1))
    assert shown(swept).facts["labels, 1 decided"] == f"{label} 1"
    assert "error" not in shown(swept).facts


def test_a_branch_shows_its_ends_and_bifurcations() -> None:
    branch = RESULTS["Branch"]()
    found = shown(branch)
    assert found.facts["a"] == f"{len(branch)} values, 0.1 to 0.5"
    assert found.facts["system"] == "Henon()"
    assert found.facts["ends where"] == str(branch.endings[1])
    (doubling,) = branch.bifurcations
    assert found.rows[-1] == ["PD", "0.3675", f"{doubling.error:.1e}", "-1", "yes"]


def test_an_orbit_shows_its_multipliers() -> None:
    orbit = RESULTS["MapOrbit"]()
    facts = shown(orbit).facts
    assert float(facts["multipliers"]) == pytest.approx(orbit.multipliers[0].real, rel=1e-5)
    assert (facts["stable"], facts["error"]) == ("no", f"{orbit.error:.1e}")


def test_a_diagram_shows_its_intervals() -> None:
    diagram = BifurcationDiagram(
        "a", np.array([1.0, 2.0, 3.0]), {"x": np.zeros((3, 1))}, list("PPQ")
    )
    assert shown(diagram).rows[-2:] == [["P", "1", "2", "2"], ["Q", "3", "3", "1"]]


def test_basins_show_their_fractions() -> None:
    found = basins(Logistic(rate=3.2), [[-0.1], [0.3], [0.5], [0.7]], progress=False)
    assert shown(found).rows[-1][:4] == ["0", "P(2)", "3", "0.75"]
    assert shown(found).facts["runs away"] == "1"


def test_measures_show_what_they_hold() -> None:
    facts = shown(TimeSeries([0.5, -0.25], [0.0, 2.0])).facts
    assert facts["times"] == "2 values, 0 to 2"
    assert facts["values"] == "2 values, -0.25 to 0.5"
    assert facts["cost"].endswith(" s, 2 samples")
    assert shown(ChatterRatios(np.array([2.0, 1.0, 0.5]))).rows[-1][:2] == ["2", "0.5"]


def test_measures_show_their_numbers_once_they_are_known() -> None:
    spectrum = LyapunovSpectrum(RESULTS["MapAttractor"](), iterations=128)
    page = spectrum._repr_html_()
    assert "not computed yet" in page
    assert not Reader(page).rows
    assert "_run" not in vars(spectrum)
    (value,), (error,) = spectrum.exponents, spectrum.error
    heads, row = shown(spectrum).rows
    assert heads == ["exponent", "value", "error"]
    assert row == ["1", f"{value:.6g}", f"{error:.6g}"]


@pytest.mark.usefixtures("_nothing_is_simulated")
def test_errors_of_measures_that_must_be_simulated_are_not_shown() -> None:
    chain = ImpactChain(masses=2, frequency=0.9)
    series = TimeSeries(chain.attractor(transient=5, impacts=60), [0.0, 1.0])
    assert {"error", "impacts"}.isdisjoint(shown(series).facts)


def test_sweeps_maps_and_basins_name_their_system() -> None:
    chain = ImpactChain(masses=2, frequency=0.9, damping=0.2)
    values = [0.9, 1.0]
    swept = sweep(chain, "frequency", values, transient=5, keep=5, progress=False)
    mapped = parameter_map(
        chain, {"frequency": values, "damping": [0.2]}, transient=5, keep=5, progress=False
    )
    assert shown(swept).facts["system"] == "ImpactChain(masses=2, damping=0.2)"
    assert shown(mapped).facts["system"] == "ImpactChain(masses=2)"
    assert shown(RESULTS["Basins"]()).facts["system"].startswith("Logistic(rate=")


def test_a_sweep_that_was_loaded_without_its_system_names_its_class(tmp_path: Path) -> None:
    path = tmp_path / "sweep.h5"
    sweep(Logistic(), "rate", [3.1, 3.2], start=[0.3], store=path, progress=False)
    assert shown(Sweep.load(path)).facts["system"] == "Logistic"
    assert shown(Sweep.load(path, Logistic())).facts["system"] == "Logistic()"
