"""`view`: results in the browser."""

from __future__ import annotations

import os
import sys
from abc import ABC, abstractmethod
from typing import Any, final

from dynkit.core.validation import boolean, non_negative_integer
from dynkit.data.atomic_files import place
from dynkit.viewer.html import refuse_without_plotly
from dynkit.viewer.page import Page

MOTIONS = 200
"""Default of the largest number of time series."""


class Viewed(ABC):
    """A result that is shown in the browser."""

    @abstractmethod
    def _page(self, motions: int) -> Page:
        """Return the page, with time series of at most `motions` points."""

    @final
    def view(
        self,
        out: str | os.PathLike[str] | None = None,
        *,
        motions: int = MOTIONS,
        show: bool = True,
    ) -> Page:
        """Show the result in the browser; see `dynkit.view`."""
        return view(self, out=out, motions=motions, show=show)


def view(
    *results: Viewed,
    out: str | os.PathLike[str] | None = None,
    motions: int = MOTIONS,
    show: bool = True,
) -> Page:
    """Show results in the browser, and return the page.

    A page is one file that needs neither a server nor a network. Its diagram can be zoomed, and
    describes the point under the pointer. A click on a point, or an arrow key, shows the time
    series, phase portrait and animation of a point. They are computed when the page is made.

    Parameters
    ----------
    *results : Sweep, ParameterMap, Basins, Branch, BifurcationCurve, Network, or one motion
        A motion is an attractor, a record or a periodic orbit. Its diagram shows the states on the
        section.
        Several results with the same axes are drawn in one diagram, the last one above.
    out : path, optional
        File for the page; by default a temporary one.
    motions : int
        Largest number of points with time series, evenly chosen; the others show the nearest one.
    show : bool
        Whether to open the page in the browser. A notebook shows the page itself instead.

    Returns
    -------
    Page

    Raises
    ------
    ImportError
        When plotly is not installed: ``pip install 'dynkit[view]'``.
    ValueError
        When a result cannot be shown, axes differ, the page would be too large, or the file cannot
        be written.

    Examples
    --------
    >>> from dynkit import sweep, view
    >>> from dynkit.systems import Logistic
    >>> found = sweep(Logistic(rate=3.0), "rate", [3.2, 3.5], start=[0.3], progress=False)
    >>> view(found, show=False)
    <Page 'Sweep of rate': 2 points, 2 time series>
    """
    most = non_negative_integer("motions", motions)
    shown = boolean("show", show)
    if out is not None:
        place("out", out)
    if not results:
        raise ValueError("results must be at least one; got none")
    given: tuple[object, ...] = results
    for result in given:
        if not isinstance(result, Viewed):
            kinds = "sweeps, parameter maps, basins, branches, curves, networks or motions"
            raise ValueError(f"results must be {kinds}; got {result!r}")
    if shown or out is not None:
        refuse_without_plotly()
    page = results[0]._page(most)
    for result in results[1:]:
        page = result._page(most).over(page)
    page = page.thinned()
    if shown and not _in_notebook():
        page.show(out)
    elif out is not None:
        page.write(out)
    return page


def _in_notebook() -> bool:
    known: Any = sys.modules.get("IPython")
    return known is not None and hasattr(known.get_ipython(), "kernel")
