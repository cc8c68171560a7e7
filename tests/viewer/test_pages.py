"""Pages hold what the results hold, need nothing else, and say what they leave out."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from dynkit import (
    BifurcationCurve,
    Branch,
    Hyperplane,
    MapAttractor,
    Network,
    PoincareMap,
    Sweep,
    basins,
    continue_orbit,
    equilibrium,
    explore,
    periodic_orbit,
    sweep,
    view,
)
from dynkit.systems import Henon, Logistic, Lorenz, SingleImpactOscillator, VanDerPol
from dynkit.viewer import html
from dynkit.viewer.page import LOOKS
from dynkit.viewer.series import Series
from dynkit.viewer.viewing import MOTIONS, Viewed
from tests.viewer.pages import (
    CHAIN,
    branch,
    branch_of_impacts,
    curve,
    data_of,
    grid,
    many,
    network,
    plane,
    swept,
)

RESULTS: list[Callable[[], Viewed]] = [swept, branch, branch_of_impacts, curve, plane, grid]


@pytest.mark.parametrize("result", RESULTS)
def test_a_page_is_one_file_that_refers_to_no_other(result: Callable[[], Viewed]) -> None:
    text = result().view(show=False).html()
    bundle = get_plotlyjs()
    assert text.count(bundle) == 1
    own = re.sub(r'"bdata": "[^"]*"', "", text.replace(bundle, ""))
    assert not re.findall(r"https?:|//[a-z]|@import|url\(|<link|<img|<iframe| src=", own)
    policy = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', own)
    assert policy[0].startswith("default-src 'none';")
    assert "connect-src" not in policy[0]  # the default applies: no request is allowed
    assert len(text) - len(bundle) < 2_000_000


def test_dots_are_the_kept_states_of_a_sweep() -> None:
    found, data = swept(), data_of(swept().view(show=False))
    kept = found.observable("relative_velocity")
    assert data["names"] == ["frequency", "relative_velocity"]
    there = ~np.isnan(kept)
    np.testing.assert_array_equal(data["y"], kept[there])
    np.testing.assert_array_equal(data["x"], found.values[data["point"]])
    label = data["facts"]["label"]
    names = [label["names"][code] for code in label["codes"].tolist()]
    assert names == [each.name for each in found.labels]


def test_series_of_a_sweep_are_those_of_its_attractors() -> None:
    data = data_of(swept().view(show=False))
    assert data["owners"] == list(range(9))
    assert data["nearest"].tolist() == list(range(9))
    for place, series in zip(data["owners"], data["series"], strict=True):
        motion = swept().attractor(place).time_series(series["times"].astype(float))
        # float32, and velocities that jump at impacts
        np.testing.assert_allclose(series["columns"]["x₁"], motion[:, 0], atol=1e-6)
        np.testing.assert_allclose(series["columns"]["x₂"], motion[:, 1], atol=1e-6)
        gap = series["columns"]["x₂"] - series["columns"]["table"]
        assert gap.min() > -1e-6
        assert abs(gap[series["marks"]]).max() < 1e-6


def test_the_page_of_a_motion_shows_its_section_and_the_motion() -> None:
    motion = CHAIN.attractor(keep=12)
    data = data_of(motion.view(show=False))
    assert data["names"] == ["phase", "relative_velocity"]
    np.testing.assert_array_equal(data["x"], motion.record.phase)
    np.testing.assert_array_equal(data["y"], motion.record.relative_velocity)
    assert data["nearest"].tolist() == [0] * 12
    (series,) = data["series"]
    exact = motion.time_series(series["times"].astype(float))
    np.testing.assert_allclose(series["columns"]["x₁"], exact[:, 0], atol=1e-6)


def test_points_of_a_map_of_one_coordinate_are_those_of_its_figure() -> None:
    motion = MapAttractor(Logistic(rate=3.2), np.array([0.3]), transient=20, iterations=7)
    data = data_of(motion.view(show=False))
    assert data["names"] == ["state[0]", "next state[0]"]
    (drawn,) = motion.plot().get_lines()
    np.testing.assert_array_equal(np.transpose([data["x"], data["y"]]), drawn.get_xydata())


def test_a_motion_without_impacts_is_shown() -> None:
    far = SingleImpactOscillator(frequency=4.0, stop=2.0)
    for motion in (far.attractor(), far.simulate(impacts=5)):
        page = motion.view(show=False)
        assert (len(page.x), len(page.look), len(page.series)) == (0, 1, 1)
        assert any("no states on its section" in note for note in page.notes)


@pytest.mark.parametrize(("guess", "look"), [([0.8, 0.2], "stable"), ([-2.0, -0.6], "unstable")])
def test_the_page_of_an_orbit_says_whether_it_is_stable(guess: list[float], look: str) -> None:
    page = periodic_orbit(Henon(a=0.2), guess).view(show=False)
    assert [LOOKS[k] for k in page.look] == [look]


def test_a_periodic_motion_ends_where_it_begins() -> None:
    for series in branch_of_impacts().view(show=False).series:
        for name in ("x₁", "x₂", "v₂"):
            column = series.columns[name]
            assert abs(column[-1] - column[0]) < 1e-9
        assert series.marks == [len(series.times) - 1]


def test_points_of_a_branch_are_told_apart_by_their_look() -> None:
    found, page = branch(), branch().view(show=False)
    count = len(found) + len(found.bifurcations)
    assert len(page.look) == count
    looks = [LOOKS[k] for k in page.look]
    assert looks.count("stable") == found.stable.sum()
    assert looks.count("bifurcation") == 1
    (doubling,) = found.bifurcations
    at = looks.index("bifurcation")
    assert page.facts["a"][at] == doubling.value
    assert page.facts["kind"][at] == "PD, period doubling"
    assert set(page.lines) == {"stable", "unstable"}
    # the style of a line or a symbol differs, not the colour alone
    script = Path(html.__file__).with_name("page.js").read_text(encoding="utf-8")
    assert 'stable: "solid", unstable: "dash", inadmissible: "dot"' in script
    assert 'stable: "circle", unstable: "circle-open"' in script


def test_inadmissible_orbits_are_shown_and_named() -> None:
    found = continue_orbit(
        CHAIN.replace(frequency=1.0).periodic_orbit(impacts=1, periods=2),
        "frequency",
        bounds=(0.9, 1.1),
    )
    page = found.view(show=False)
    bad = [LOOKS[k] == "inadmissible" for k in page.look]
    assert sum(bad) == (~found.admissible).sum() > 0
    said = [text == "no" for text in page.facts["admissible"]]
    assert sum(said) == sum(bad) + sum(not b.admissible for b in found.bifurcations)


def test_regions_of_a_plane_are_its_labels() -> None:
    found, data = plane(), data_of(plane().view(show=False))
    cells = data["cells"]
    np.testing.assert_array_equal(cells["x"], found.values["a"])
    np.testing.assert_array_equal(cells["y"], found.values["b"])
    names = np.array([name for name, _ in cells["regions"]])[cells["numbers"]]
    labels = found.names.ravel()
    periodic = np.char.startswith(labels, "P(")
    np.testing.assert_array_equal(names[periodic], labels[periodic])
    shades = [shade for _, shade in cells["regions"]]
    assert len(set(shades)) == len(shades)
    assert data["owners"] == list(range(35))


def test_starts_of_a_basin_show_the_motion_on_its_attractor() -> None:
    found, page = grid(), grid().view(show=False)
    assert page.nearest is not None
    flat = found.numbers.ravel()
    assert (page.nearest[flat < 0] == -1).all()
    (series,) = page.series
    assert (page.nearest[flat == 0] == 0).all()
    assert {len(np.unique(series.columns["state[0]"].round(6)))} == {4}  # P(4)


def test_starts_in_a_row_show_their_attractors() -> None:
    starts = np.linspace(-0.2, 0.9, 12)[:, None]
    found = basins(Logistic(rate=3.2), starts, progress=False)
    page = found.view(show=False)
    assert page.cells is None
    assert page.y.tolist() == found.numbers.tolist()
    assert page.nearest is not None
    np.testing.assert_array_equal(page.nearest, np.maximum(found.numbers, -1))


def test_a_network_shows_all_branches() -> None:
    found, page = network(), network().view(show=False)
    assert len(found) >= 2
    assert len(page.look) == sum(len(each) + len(each.bifurcations) for each in found.branches)
    assert np.unique(page.track).tolist() == list(range(len(found)))
    with pytest.raises(ValueError, match="network must have a branch to be shown; got none"):
        replace(found, branches=()).view(show=False)


def test_a_curve_of_bifurcations_shows_its_points_and_orbits() -> None:
    found, page = curve(), curve().view(show=False)
    assert page.names == ("a", "b")
    np.testing.assert_array_equal(np.column_stack([page.x, page.y]), found.parameters)
    assert {LOOKS[k] for k in page.look} == {"bifurcation"}
    place = page.owners[0]
    (name, *_), orbit = page.series[0].shown, found.orbit(place)
    assert np.isclose(page.series[0].columns[name], orbit.observable(orbit.observables[0])[0]).any()


def test_lines_of_two_branches_are_both_drawn() -> None:
    one, both = branch().view(show=False), view(branch(), branch(), show=False)
    for look, (x, y) in one.lines.items():
        assert np.isfinite(both.lines[look][0]).sum() == 2 * np.isfinite(x).sum()
        assert np.isfinite(both.lines[look][1]).sum() == 2 * np.isfinite(y).sum()


def test_results_with_the_same_axes_share_a_diagram() -> None:
    page = view(swept(), branch_of_impacts(), show=False)
    below, above = swept().view(show=False), branch_of_impacts().view(show=False)
    assert len(page.look) == len(below.look) + len(above.look)
    assert page.nearest is not None
    assert len(page.series) == len(below.series) + len(above.series)
    shift = len(below.look)
    assert page.track[shift] == 1
    assert page.owners[page.nearest[shift]] == shift
    assert page.facts["kind"][0] == ""
    assert data_of(page)["series"]
    with pytest.raises(ValueError, match="results must have the same axes and no regions"):
        view(swept(), branch(), show=False)
    with pytest.raises(ValueError, match="results must have the same axes and no regions"):
        view(swept(), plane(), show=False)


def test_flows_move_between_the_crossings_of_their_section() -> None:
    flow = VanDerPol()
    section = PoincareMap(
        flow, Hyperplane(np.array([0.0, 1.0]), 0.0, direction=-1), time_limit=50.0
    )
    found = sweep(section, "mu", [1.0], start=[2.0], transient=20, keep=4, progress=False)
    (series,) = found.view(show=False).series
    assert not series.discrete
    state = np.array([series.columns["flow[0]"][0], series.columns["flow[1]"][0]])
    middle = len(series.times) // 3
    expected = flow.replace(mu=1.0).advance(state, float(series.times[middle]))
    assert series.columns["flow[0]"][middle] == pytest.approx(expected[0], abs=1e-6)
    # one period
    assert series.columns["flow[0]"][-1] == pytest.approx(state[0], abs=1e-6)


def test_equilibria_rest() -> None:
    found = continue_orbit(equilibrium(Lorenz(rho=5.0), [3.0, 3.0, 4.0]), "rho", bounds=(4.0, 6.0))
    page = found.view(show=False)
    assert page.series == []
    assert "eigenvalues" in page.facts


# --- what is left out -----------------------------------------------------------------------------


@pytest.mark.parametrize("motions", [0, 1, 4, 9, MOTIONS])
def test_motions_are_chosen_evenly_and_the_page_says_so(motions: int) -> None:
    page = swept().view(motions=motions, show=False)
    assert len(page.series) == min(motions, 9)
    note = f"{motions} of 9 points, evenly chosen, have time series in this file."
    assert any(each.startswith(note) for each in page.notes) == (0 < motions < 9)
    if motions == 4:
        gaps = np.diff(page.owners)
        assert gaps.max() - gaps.min() <= 1
    assert page.nearest is not None
    places, owners = np.arange(9), np.array(page.owners)
    for place in places[: 9 * bool(motions)]:
        away = abs(owners - place)
        assert away[page.nearest[place]] == away.min()


@pytest.mark.parametrize("motions", [1, 6, 12, 34])
def test_motions_of_a_plane_are_of_its_own_regions(motions: int) -> None:
    page = plane().view(motions=motions, show=False)
    assert 0 < len(page.series) <= motions
    assert page.nearest is not None
    assert page.cells is not None
    numbers = page.cells.numbers.ravel()
    for place in np.flatnonzero(page.nearest >= 0).tolist():
        assert numbers[page.owners[page.nearest[place]]] == numbers[place]


def test_too_many_dots_are_thinned_and_too_many_points_refused() -> None:
    page = many(240_000).thinned()
    assert len(page.point) == 200_000
    assert page.notes == ["The diagram shows 200000 of 240000 dots, evenly chosen."]
    assert (np.diff(page.point) > 0).all()
    with pytest.raises(ValueError, match="a page must have at most 250000 points; got 250001"):
        many(250_001)


def test_a_page_that_is_too_large_is_refused() -> None:
    x = np.zeros(5_000_000)
    huge = Series(x, {"x": x}, ("x",), ("x", "x"))
    with pytest.raises(ValueError, match=r"page must be at most 48 MB; got 58 MB: ask for fewer"):
        replace(many(1), series=[huge]).html()


def test_a_result_without_its_system_is_shown_without_motions(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    for found, kind in ((swept(), Sweep), (curve(), BifurcationCurve), (branch(), Branch)):
        found.save(store)
        page = kind.load(store).view(show=False)
        assert len(page.series) == 0
        assert "loaded without" in " ".join(page.notes)
        assert "No time series" not in data_of(page)["notes"]
    assert page.names == ("a", "largest modulus of the spectrum")
    moduli = abs(branch().multipliers).max(axis=1)
    points = [LOOKS[k] != "bifurcation" for k in page.look]
    np.testing.assert_array_equal(page.y[points], moduli)


# --- files, notebooks, wrong input ----------------------------------------------------------------


def test_texts_of_a_result_cannot_end_the_page() -> None:
    page = replace(many(3), title="</title><b>", facts={"</script>": ["<i>", "&", "</script>"]})
    text = page.html().replace(get_plotlyjs(), "")
    assert text.count("</script>") == 3
    assert "<title>&lt;/title&gt;&lt;b&gt;</title>" in text
    assert data_of(page)["facts"]["</script>"]["names"] == ["<i>", "&", "</script>"]


def test_the_page_goes_to_a_file_and_opens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    out = tmp_path / "x.html"
    page = branch().view(out)
    assert out.read_text(encoding="utf-8") == page.html()
    assert opened == [out.as_uri()]
    branch().view(out, show=False)
    assert len(opened) == 1
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: str(tmp_path))
    branch().view(motions=0)
    assert opened[1] == (tmp_path / "view.html").as_uri()


def test_a_notebook_shows_the_page_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    class Shell:
        kernel = object()

        @staticmethod
        def get_ipython() -> object:
            return Shell

    monkeypatch.setitem(sys.modules, "IPython", Shell)
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("no browser in a notebook"))
    text = branch().view(motions=0)._repr_html_()
    assert text.startswith('<iframe title="Branch of P(1) along a" srcdoc="&lt;!DOCTYPE html&gt;')
    assert "<script" not in text  # it is escaped


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((), {}, "results must be at least one; got none"),
        (
            ("x.h5",),
            {},
            "results must be sweeps, parameter maps, basins, branches, curves, networks or motions",
        ),
        ((Logistic(rate=3.0),), {}, "got Logistic"),
        ((None,), {"motions": -1}, "motions must be"),
        ((None,), {"show": "yes"}, "show must be"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: tuple[object], options: dict[str, object], message: str
) -> None:
    function: Callable[..., object] = view
    with pytest.raises(ValueError, match=message):
        function(*arguments, **options)


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="out must be in a folder that exists"):
        branch().view(tmp_path / "no" / "x.html", show=False)


def test_without_plotly_the_extra_is_named_before_anything_is_computed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(html, "find_spec", lambda _: None)
    monkeypatch.setattr(Sweep, "_page", lambda *_: pytest.fail("nothing is computed"))
    with pytest.raises(ImportError, match=r"pip install 'dynkit\[view\]'"):
        swept().view()


def test_the_same_result_gives_the_same_page() -> None:
    assert branch().view(show=False).html() == branch().view(show=False).html()


def test_a_network_loads_with_its_orbits(tmp_path: Path) -> None:
    orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    found = explore(Henon(a=0.2, b=0.3), "a", (0.1, 0.3), iterates=1, seeds=[orbit])
    store = tmp_path / "x.h5"
    found.save(store)
    assert Network.load(store).view(show=False).series == ()
    assert len(Network.load(store, [orbit]).view(show=False).series) > 0
