"""No text of a figure is printed over another, and no axis has an offset at its end."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.text import Text

from dynkit import Branch, Sweep, basins, continue_orbit, explore, parameter_map, sweep
from dynkit.analysis import (
    POD,
    BifurcationDiagram,
    ChatterRatios,
    CorrelationDimension,
    ImpactSection,
    LyapunovSpectrum,
    PowerSpectrum,
    Sensitivity,
    SpaceTime,
    TimeSeries,
    mark_values,
)
from dynkit.plotting.figures import new_figure
from dynkit.plotting.ticks import WholeNumbers
from dynkit.systems import (
    DryFriction,
    HardStop,
    Henon,
    ImpactAttractor,
    ImpactChain,
    Logistic,
    PlayOscillator,
    SingleImpactOscillator,
    SoftStop,
)
from tests.pictures import overprinted

CHAIN = ImpactChain(frequency=0.87)
SMALL = CHAIN.replace(amplitude=1e-7)
MASS = SingleImpactOscillator(frequency=2.0, restitution=0.7)


@cache
def chaos() -> ImpactAttractor:
    return CHAIN.replace(frequency=1.346).attractor(impacts=400)


@cache
def swept() -> Sweep:
    return sweep(CHAIN, "frequency", np.arange(0.14, 2.0, 0.02), progress=False)


@cache
def branch(chain: ImpactChain) -> Branch:
    orbit = chain.periodic_orbit(impacts=1, periods=3)
    return continue_orbit(orbit, "frequency", bounds=(0.7, 1.1))


def many_names() -> Branch:
    """Return a branch with five period doublings, two of them beside each other."""
    orbit = ImpactChain(masses=3, frequency=0.9).periodic_orbit(impacts=1, periods=4)
    return continue_orbit(orbit, "frequency", bounds=(0.7, 1.3))


def marked() -> None:
    modes = enumerate(CHAIN.natural_frequencies)
    mark_values(swept().plot(), {f"$w_{{{i + 1}}}$": float(w) for i, w in modes})


def basins_of_a_pair() -> None:
    pair = PlayOscillator(play=1.0, amplitude=0.4, frequency=1.0, restitution=0.6)
    grid = [[[0.0, v, p] for v in (-1.0, 0.0, 1.0)] for p in (0.0, 1.0, 2.0)]
    basins(pair, grid, transient=20, keep=10, progress=False).plot()


def plane() -> None:
    values = {"frequency": np.linspace(1.6, 3.6, 6), "stop": np.linspace(-0.4, 0.2, 5)}
    parameter_map(MASS, values, transient=100, keep=20, progress=False).plot()


def machine() -> None:
    elements = [
        HardStop(3, amplitude=0.1, restitution=0.85, name="table"),
        HardStop((1, 2), offset=-0.2, restitution=0.5, name="clash"),
        SoftStop(1, offset=-0.3, stiffness=50.0, damping=0.2, name="pad"),
        DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt"),
    ]
    ImpactChain(masses=4, frequency=0.9, elements=elements).plot()


def narrow() -> None:
    sweep(CHAIN, "frequency", np.linspace(0.8, 0.80001, 11), progress=False).plot()


def chatter() -> None:
    record = CHAIN.replace(frequency=0.40816).attractor(impacts=300).record
    ChatterRatios(np.diff(record.time)).plot()


FIGURES: dict[str, Callable[[], Any]] = {
    "diagram": lambda: BifurcationDiagram.of(swept()).plot(),
    "natural frequencies": marked,
    "narrow sweep": narrow,
    "branch": lambda: branch(CHAIN).plot(),
    "branch with many names": lambda: many_names().plot(),
    "branch of small motions": lambda: branch(SMALL).plot(),
    "orbit of small motions": lambda: SMALL.periodic_orbit(impacts=1, periods=3).plot(),
    "record": lambda: chaos().record.plot(end=1000.0),
    "section": lambda: ImpactSection(chaos()).plot(),
    "velocities of a section": lambda: ImpactSection(chaos()).plot_velocity(),
    "time series": lambda: TimeSeries(chaos()).plot(),
    "spectrum": lambda: PowerSpectrum(chaos()).plot(),
    "power of modes": lambda: POD(chaos()).plot(),
    "modes": lambda: POD(chaos()).plot_modes(),
    "space and time": lambda: SpaceTime(chaos()).plot(),
    "exponents": lambda: LyapunovSpectrum(chaos(), iterations=500).plot(),
    "sensitivity": lambda: Sensitivity(chaos()).plot(),
    "dimension": lambda: CorrelationDimension(
        Henon().attractor(start=[0.0, 0.0], keep=3000)
    ).plot_slopes(),
    "chatter": chatter,
    "network": lambda: explore(
        Logistic(rate=3.0), "rate", (2.5, 4.0), iterates=4, box=[(0.0, 1.0)]
    ).plot(),
    "network with grazings": lambda: explore(
        MASS, "frequency", (2.6, 3.0), periods=1, values=2
    ).plot(),
    "plane": plane,
    "basins": basins_of_a_pair,
    "machine": machine,
}


@pytest.mark.parametrize("name", FIGURES)
def test_no_text_is_printed_over_another_and_all_are_of_one_font(name: str) -> None:
    FIGURES[name]()
    figure = plt.gcf()
    texts = overprinted(figure)
    fonts = {
        (*text.get_fontfamily(), text.get_math_fontfamily())
        for text in cast("list[Text]", figure.findobj(Text))
        if text.get_text()
    }
    plt.close(figure)
    assert texts == []
    assert fonts == {("serif", "dejavuserif")}


@pytest.mark.parametrize(
    ("low", "high"), [(1e-7, 2e-7), (0.8, 0.8 + 1e-9), (-1e21, 1e21), (1e3, 2e5), (-0.5, 0.5)]
)
def test_numbers_beside_ticks_are_whole_and_apart(low: float, high: float) -> None:
    figure, (axes,) = new_figure()
    axes.plot([low, high], [low, high])
    axes.set(xlabel="x", ylabel="y")
    assert overprinted(figure) == []
    for axis in (axes.xaxis, axes.yaxis):
        written = [(tick.get_loc(), tick.label1.get_text()) for tick in axis.get_major_ticks()]
        seen = [(place, text) for place, text in written if text and low <= place <= high]
        assert len(seen) >= 2
        for place, text in seen:
            assert number(text) == pytest.approx(place, rel=1e-8, abs=1e-8 * (high - low))


def number(text: str) -> float:
    mantissa, _, power = text.replace("\N{MINUS SIGN}", "-").partition(r"$\cdot 10^{")
    return float(f"{mantissa}e{power.removesuffix('}$') or 0}")


def test_a_figure_with_whole_numbers_is_copied() -> None:
    figure = new_figure()[0]
    copied = cast("Figure", pickle.loads(pickle.dumps(figure)))
    assert isinstance(copied.axes[0].xaxis.get_major_formatter(), WholeNumbers)
