"""The pictures of the first page: ``python -m docs._extensions.pictures`` draws them again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from dynkit import continue_orbit, sweep
from dynkit.plotting.figures import new_figure, write_figure
from dynkit.systems import ImpactChain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).parents[1] / "_static"
CHAIN = ImpactChain(masses=10, frequency=0.87)
# Frequencies at which the orbits P(1,m), m = 1 to 5, are motions of the chain.
_FREQUENCIES = (0.64, 1.1, 0.87, 1.17, 1.45)


def machine() -> Figure:
    """Return the sketch of the chain of ten masses above its table."""
    return cast("Figure", CHAIN.plot().figure)


def diagram() -> Figure:
    """Return the bifurcation diagram of the chain, with the branches of P(1,m)."""
    figure, (axes,) = new_figure(6.8, 3.4)
    sweep(CHAIN, "frequency", np.arange(0.5, 1.5, 0.001), progress=False).plot(axes)
    axes.lines[0].set_color("0.6")
    axes.set(xlim=(0.5, 1.5), ylim=(0.0, 0.3))
    for periods, frequency in enumerate(_FREQUENCIES, 1):
        orbit = CHAIN.replace(frequency=frequency).periodic_orbit(impacts=1, periods=periods)
        continue_orbit(orbit, "frequency", bounds=(0.5, 1.5), inadmissible=False).plot(axes)
    return figure


PICTURES = {"machine.png": machine, "diagram.png": diagram}


if __name__ == "__main__":
    from tests.pictures import describe_pictures

    describe_pictures()
    for name, draw in PICTURES.items():
        write_figure("out", FOLDER / name, draw(), resolution=220.0)
