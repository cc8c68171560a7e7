"""A page for the browser: the diagram of a result, and the motions of its points.

RESULTS.h5 is a store of a sweep, a map of two parameters, a branch, a curve of
bifurcations, a network, basins, an attractor, a record or an orbit, as --store
and save() write it. The page is one file that needs no network. A click on a
point, or the arrow keys, show its time series, phase portrait and animation.
The motions are computed when the page is made, where the store describes its
system: one of dynkit.systems with numbers and elements as arguments. For other
systems the page has the diagram alone; in Python, the method view() of a
result that was loaded with its system makes all of it.

For instance:
  dynkit sweep --from 0.70 --to 0.76 --step 0.002 --store sweep.h5
  dynkit view sweep.h5
  dynkit view sweep.h5 --out sweep.html --motions 500
  dynkit view branch.h5 --out branch.html --no-show
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynkit.cli.options import Asked, Option
from dynkit.cli.output import output_file, print_summary
from dynkit.cli.stored import loaded
from dynkit.core.validation import non_negative_integer
from dynkit.viewer.html import refuse_without_plotly
from dynkit.viewer.viewing import MOTIONS, view

if TYPE_CHECKING:
    from dynkit.viewer.page import Page

OPTIONS = (
    Option("results", "RESULTS.h5", "store of a result", positional=True),
    Option("out", "FILE", "file for the page, .html (a temporary one)"),
    Option("motions", "COUNT", f"largest number of points with time series ({MOTIONS})"),
    Option("show", "", "open the page in the browser (yes)"),
)


def run(asked: Asked) -> None:
    """Make the page, open it, and print a summary of its content.

    Raises
    ------
    ValueError
        When an option is refused, or the store cannot be shown; no file has been written then.
    """
    try:
        refuse_without_plotly()
    except ImportError as missing:
        raise ValueError(str(missing)) from missing
    motions = non_negative_integer("motions", asked.get("motions", MOTIONS))
    out = output_file("out", asked["out"], (".html",)) if "out" in asked else None
    found: Any = loaded(asked["results"])
    page: Page = view(found, motions=motions, show=False)
    shown: bool = asked.get("show", True)
    file = page.show(out) if shown else page.write(out)
    said = {"shown": page.title, "points": len(page.look), "time series": len(page.series)}
    print_summary(said, file)
    for note in page.notes:
        print(note)
