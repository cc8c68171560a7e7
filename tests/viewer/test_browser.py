"""Pages in a real browser, without a window and without a network (`make test-view`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import Page, view
from dynkit.viewer.viewing import Viewed
from tests.browser import Browser
from tests.viewer.pages import (
    CHAIN,
    border,
    branch,
    branch_of_impacts,
    curve,
    grid,
    many,
    network,
    plane,
    swept,
)

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def tab(browser: Browser, tmp_path: Path) -> Callable[[Page], Browser]:
    """Opens a page, wide and light, and returns the browser."""

    def opened(page: Page) -> Browser:
        browser.size(1280, 900)
        browser.prefer(color_scheme="light", reduced_motion="reduce")
        browser.requests.clear()
        browser.errors.clear()
        browser.open(page.write(tmp_path / "x.html"))
        return browser

    return opened


def selected(tab: Browser) -> dict[str, str]:
    rows = "[...document.querySelectorAll('#facts dt')]"
    found: dict[str, str] = tab.value(
        f"Object.fromEntries({rows}.map(t => [t.textContent, t.nextSibling.textContent]))"
    )
    return found


def drawn(tab: Browser, plot: str) -> list[float]:
    """Heights of the first curve of a plot."""
    found: list[float] = tab.value(f"Array.from($('{plot}').data[0].y)")
    return found


def pixel(tab: Browser, x: float, y: float) -> Any:
    """Where a point of the diagram is in the window."""
    return tab.value(
        "(() => { const box = $('diagram').getBoundingClientRect(), p = $('diagram')._fullLayout;"
        f"return [box.x + p.xaxis._offset + p.xaxis.d2p({x}),"
        f" box.y + p.yaxis._offset + p.yaxis.d2p({y})]; }})()"
    )


Tab = Callable[[Page], Browser]


@pytest.mark.parametrize(
    "result",
    [swept, branch, branch_of_impacts, curve, border, network, plane, grid, CHAIN.attractor],
)
def test_a_page_loads_without_a_network_and_without_errors(
    tab: Tab, result: Callable[[], Viewed]
) -> None:
    shown = tab(result().view(show=False))
    assert shown.errors == []
    # the file itself, and pictures inside it
    assert {each.partition(":")[0] for each in shown.requests} <= {"file", "data", "blob"}
    assert sum(each.startswith("file:") for each in shown.requests) == 1
    # the policy of the page refuses requests
    assert (
        shown.value("fetch('data:text/plain,x').then(() => 'sent', () => 'refused')") == "refused"
    )


def test_a_click_shows_the_motion_of_that_point(tab: Tab) -> None:
    page = branch_of_impacts().view(show=False)
    shown, found = tab(page), branch_of_impacts()
    before = drawn(shown, "time"), drawn(shown, "portrait")
    at = len(found) // 2
    shown.click(*pixel(shown, found.parameter[at], found.observable("relative_velocity")[at, 0]))
    shown.wait("selected > 0")
    said = selected(shown)
    assert float(said["frequency"]) == pytest.approx(found.parameter[at], rel=1e-9)
    assert said["label"] == "P(1,1)"
    assert said["admissible"] in ("yes", "no")
    assert said["multipliers"].count(",") == 3
    after = drawn(shown, "time"), drawn(shown, "portrait")
    assert after[0] != before[0]
    assert after[1] != before[1]
    series = page.series[page.owners.index(shown.value("selected"))]
    np.testing.assert_allclose(after[0], series.columns["x₂"], rtol=1e-6, atol=1e-7)
    assert shown.value("$('machine').hidden") is False
    assert shown.errors == []


def test_a_click_on_a_curve_in_two_parameters_shows_its_orbit(tab: Tab) -> None:
    shown, found = tab(border().view(show=False)), border()
    at = len(found) // 2
    shown.click(*pixel(shown, *found.parameters[at]))
    shown.wait("selected > 0")
    said = selected(shown)
    names = ("frequency", "restitution")
    np.testing.assert_allclose([float(said[name]) for name in names], found.parameters[at])
    assert said["kind"] == "GR, grazing"
    assert len(drawn(shown, "time")) > 100
    assert shown.value("$('machine').hidden") is False
    shown.press("ArrowRight")
    assert float(selected(shown)["frequency"]) == pytest.approx(found.parameters[at + 1, 0])


def test_the_pointer_names_a_point(tab: Tab) -> None:
    shown, found = tab(network().view(show=False)), network().branches[0]
    place = pixel(shown, found.parameter[1], found.observable("state[0]")[1, 0])
    shown.call("Input.dispatchMouseEvent", type="mouseMoved", x=place[0], y=place[1])
    text = "document.querySelector('.hoverlayer').textContent"
    shown.wait(f"{text} !== ''")
    for name in ("label: P(1)", "multipliers: ", "admissible: yes"):
        assert name in shown.value(text)


def test_a_click_on_a_region_shows_its_motion(tab: Tab) -> None:
    shown, values = tab(plane().view(show=False)), plane().values
    shown.click(*pixel(shown, values["a"][4], values["b"][3]))
    shown.wait("selected > 0")
    assert shown.value("selected") == 4 * 5 + 3
    assert float(selected(shown)["a"]) == pytest.approx(values["a"][4])
    assert selected(shown)["label"] == plane().names[4, 3]


def test_the_keyboard_moves_along_the_curve(tab: Tab) -> None:
    shown, found = tab(view(swept(), branch_of_impacts(), show=False)), branch_of_impacts()
    count = len(swept())
    for key, place in (
        *(("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1)),
        *(("End", count - 1), ("ArrowRight", count - 1), ("Home", 0), ("ArrowLeft", 0)),
    ):
        shown.press(key)
        assert shown.value("selected") == place, key
    shown.press("ArrowUp")
    assert shown.value("data.track[selected]") == 1
    assert abs(float(selected(shown)["frequency"]) - 0.8) == abs(found.parameter - 0.8).min()
    shown.press("ArrowDown")
    assert shown.value("selected") == 0
    width = "$('diagram')._fullLayout.xaxis.range.reduce((a, b) => b - a)"
    before = shown.value(width)
    shown.press("+")
    shown.wait(f"{width} < 0.6 * {before}")
    shown.press("0")
    shown.wait(f"{width} > 0.9 * {before}")
    assert shown.value("document.activeElement === document.body")
    assert shown.value("$('facts').getAttribute('aria-live')") == "polite"


def test_coordinates_of_starts_have_symbols(tab: Tab) -> None:
    shown = tab(grid().view(show=False))
    title = "$('diagram')._fullLayout.{}axis.title.text"
    assert [shown.value(title.format(axis)) for axis in "xy"] == ["z₁", "z₂"]
    shown.press("ArrowRight")
    assert {"z₁", "z₂"} <= set(selected(shown))


def test_keys_of_a_plane_move_between_cells(tab: Tab) -> None:
    shown = tab(plane().view(show=False))
    for key, place in (("ArrowRight", 5), ("ArrowUp", 6), ("ArrowDown", 5), ("End", 30)):
        shown.press(key)
        assert shown.value("selected") == place, key


def test_the_animation_moves_and_pauses(tab: Tab) -> None:
    shown = tab(swept().view(show=False))
    assert shown.value("playing") is False  # reduced motion is asked for
    first = shown.value("$('machine').toDataURL()")
    shown.press(" ")
    shown.wait("clock > 0.05")
    shown.press(" ")
    assert shown.value("playing") is False
    assert shown.value("$('machine').toDataURL()") != first
    assert int(shown.value("$('now').value")) > 0
    shown.value("$('now').value = 500; $('now').dispatchEvent(new Event('input')); 1")
    half = 0.5 * swept().view(show=False).series[0].times[-1]
    assert shown.value("at().t") == pytest.approx(half, rel=1e-6)
    dot = shown.value("$('time').nextSibling.style.left")
    places = "$('time')._fullLayout.xaxis"
    place = shown.value(f"{places}._offset + {places}.d2p({half})")
    assert float(dot.removesuffix("px")) == pytest.approx(place, abs=0.1)
    shown.prefer(color_scheme="light", reduced_motion="no-preference")
    shown.press("ArrowRight")
    assert shown.value("playing") is True


def test_what_crowds_a_diagram_can_be_hidden(tab: Tab) -> None:
    shown = tab(branch().view(show=False))
    shapes = "$('diagram').data.filter(t => t.name === 'stable').map(t => t.visible ?? true)"
    assert shown.value(shapes) == [True, True]  # the line and its points
    shown.value("document.querySelector('#legend input').click()")
    first = shown.value("document.querySelector('#legend label').textContent")
    assert "stable" in first
    shown.wait(f"{shapes}.every(on => !on)")
    shown.value("document.querySelector('#legend input').click()")
    shown.wait(f"{shapes}.every(on => on)")


def test_columns_can_be_chosen_and_stay(tab: Tab) -> None:
    shown = tab(swept().view(show=False))
    shown.value("$('of').value = 'x₁'; $('of').dispatchEvent(new Event('change')); 1")
    shown.press("ArrowRight")
    series = swept().view(show=False).series[1]
    np.testing.assert_allclose(drawn(shown, "time"), series.columns["x₁"], atol=1e-6)


def test_twenty_thousand_points_stay_fluid(tab: Tab) -> None:
    shown = tab(many(20_000))
    assert shown.value("$('diagram').data[0].type") == "scattergl"
    assert shown.value("$('diagram').data[0].x.length") == 20_000
    # no element for each point, of which zooming would move all
    assert shown.value("$('diagram').querySelectorAll('*').length") < 1000
    shown.press("End")
    assert shown.value("selected") == 19_999
    assert shown.errors == []


@pytest.mark.parametrize("result", [swept, branch, border, network, plane, grid])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_the_whole_page(tab: Tab, result: Callable[[], Viewed], scheme: str) -> None:
    shown = tab(result().view(show=False))
    shown.size(360, 740, phone=True)
    shown.prefer(color_scheme=scheme, reduced_motion="reduce")
    shown.wait("$('diagram')._fullLayout.width <= 360 && $('time')._fullLayout.width <= 360")
    assert shown.value("document.documentElement.scrollWidth") <= 360
    below = "document.querySelector('#motion').getBoundingClientRect().top"
    assert shown.value(below) > shown.value("$('diagram').getBoundingClientRect().bottom")
    # text against paper, as of the guidelines for accessible pages
    assert contrast(shown, "ink") > 7.0
    assert contrast(shown, "faint") > 4.5
    assert contrast(shown, "accent") > 4.5
    shown.wait("$('diagram')._fullLayout.paper_bgcolor === colour('paper')")


def contrast(tab: Browser, shade: str) -> float:
    """Ratio of the luminances of a colour of the page and of its paper."""

    def luminance(name: str) -> float:
        text: str = tab.value(f"colour('{name}')")
        digits = text.removeprefix("#")
        digits = digits if len(digits) == 6 else "".join(2 * digit for digit in digits)
        parts = np.array([int(digits[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(shade), luminance("paper")))
    return (high + 0.05) / (low + 0.05)
