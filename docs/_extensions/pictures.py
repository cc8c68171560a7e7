"""The sketch of the first page: ``python docs/_extensions/pictures.py`` draws it again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

from dynkit.plotting.figures import write_figure
from dynkit.systems import ImpactChain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MACHINE = Path(__file__).parents[1] / "_static" / "machine.png"


def machine() -> Figure:
    """Return the sketch of the chain of ten masses above its table."""
    figure = ImpactChain(masses=10, frequency=0.87).plot().figure
    return cast("Figure", figure)


if __name__ == "__main__":
    from tests.pictures import describe_pictures

    describe_pictures()
    write_figure("out", MACHINE, machine(), resolution=220.0)
