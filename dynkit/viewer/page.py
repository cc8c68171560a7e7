"""Pages for the browser: the points of a result, and the motions of these points."""

from __future__ import annotations

import os
import tempfile
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.data.atomic_files import place, whole
from dynkit.viewer.html import html_of
from dynkit.viewer.series import Series

LOOKS = ("motion", "stable", "unstable", "inadmissible", "bifurcation", "inadmissible bifurcation")
"""How points are drawn, by number."""

# Largest numbers of points, dots and bytes of a page: browsers show it without delay up to here.
_MOST_POINTS, _MOST_DOTS, _MOST_BYTES = 250_000, 200_000, 48_000_000

Facts = Mapping[str, Any]
"""Numbers or texts of points, (p,) each, by name; NaN and empty texts are not shown."""


@final
@dataclass(frozen=True, eq=False)
class Cells:
    """Regions of a plane: point number i * k2 + j lies at x[i], y[j].

    Parameters
    ----------
    x, y : (k1,), (k2,) arrays
    numbers : (k1, k2) array of int
        Indices into `regions`.
    regions : sequence of (str, str)
        Names, and colours in CSS.
    """

    x: Array
    y: Array
    numbers: NDArray[np.int64]
    regions: Sequence[tuple[str, str]]


@final
@dataclass(frozen=True, eq=False)
class Page:
    """A page for the browser: a diagram, and the motions of its points; made by `view`.

    A notebook shows it as the last value of a cell.

    Parameters
    ----------
    title : str
    names : (str, str)
        Names of the two axes of the diagram.
    track, look : (p,) arrays of int
        For each point the number of its curve, and its look in `LOOKS`. The points of a curve are
        in its order.
    facts : mapping of str to (p,) array or list of str
    point : (d,) array of int
        Ascending: the point to which each dot belongs.
    x, y : (d,) arrays
        The dots.
    lines : mapping of str to ((q,) array, (q,) array)
        Lines by their look; NaN separates them.
    cells : Cells, optional
    notes : sequence of str
        Notes to the reader, shown on the page.
    series : sequence of Series
    nearest : (p,) array of int
        The number of the time series nearest to each point; -1 without one.
    owners : sequence of int
        The point of each time series.
    """

    title: str
    names: tuple[str, str]
    track: NDArray[np.int64]
    look: NDArray[np.int64]
    facts: Facts
    point: NDArray[np.int64]
    x: Array
    y: Array
    lines: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    cells: Cells | None = None
    notes: Sequence[str] = ()
    series: Sequence[Series] = ()
    nearest: NDArray[np.int64] | None = None
    owners: Sequence[int] = ()

    def __repr__(self) -> str:
        return f"<Page {self.title!r}: {len(self.look)} points, {len(self.series)} time series>"

    def html(self) -> str:
        """Return the page: one file that needs no other, and no network.

        Raises
        ------
        ImportError
            When plotly is not installed.
        ValueError
            When the page would be larger than browsers show without delay.
        """
        text = html_of(self.title, self._data())
        if len(text) > _MOST_BYTES:
            raise ValueError(
                f"page must be at most {_MOST_BYTES // 1_000_000} MB; got "
                f"{len(text) // 1_000_000} MB: ask for fewer motions"
            )
        return text

    def write(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the page to a file, and return its path. After a failure the old file remains.

        Parameters
        ----------
        path : path, optional
            By default a new file in the folder for temporary files.

        Raises
        ------
        ImportError, ValueError
            As `html`; also when the file cannot be written.
        """
        text = self.html()
        file = (
            Path(tempfile.mkdtemp(prefix="dynkit-"), "view.html")
            if path is None
            else place("out", path)
        )
        with whole("out", file) as stream:
            stream.write(text.encode())
        return file

    def show(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the page to a file, as `write`, open it in the browser, and return its path.

        Raises
        ------
        ImportError, ValueError
            As `write`.
        """
        file = self.write(path)
        webbrowser.open(file.resolve().as_uri())
        return file

    def _repr_html_(self) -> str:
        return (
            f'<iframe title="{escape(self.title)}" srcdoc="{escape(self.html())}" '
            'style="width:100%;height:44rem;border:0"></iframe>'
        )

    def _data(self) -> dict[str, Any]:
        cells = self.cells
        return {
            "names": self.names,
            "looks": LOOKS,
            "track": self.track.astype(np.int32),
            "look": self.look.astype(np.int32),
            "facts": {name: _column(values) for name, values in self.facts.items()},
            "point": self.point.astype(np.int32),
            "x": np.asarray(self.x, np.float64),
            "y": np.asarray(self.y, np.float64),
            "lines": self.lines,
            "cells": None
            if cells is None
            else {
                "x": np.asarray(cells.x, np.float64),
                "y": np.asarray(cells.y, np.float64),
                "numbers": cells.numbers.ravel().astype(np.int32),
                "regions": cells.regions,
            },
            "notes": self.notes,
            "owners": self.owners,
            "nearest": self._nearest.astype(np.int32),
            "series": [_packed(series) for series in self.series],
        }

    @property
    def _nearest(self) -> NDArray[np.int64]:
        return np.full(len(self.look), -1) if self.nearest is None else self.nearest

    def __post_init__(self) -> None:
        if len(self.look) > _MOST_POINTS:
            raise ValueError(
                f"a page must have at most {_MOST_POINTS} points; got {len(self.look)}"
            )

    def noting(self, note: str) -> Page:
        """Return the page with one more note."""
        return replace(self, notes=[*self.notes, note])

    def thinned(self) -> Page:
        """Return the page with at most as many dots as a browser shows quickly."""
        count = len(self.point)
        if count <= _MOST_DOTS:
            return self
        kept = np.unique(np.linspace(0, count - 1, _MOST_DOTS).astype(np.int64))
        note = f"The diagram shows {len(kept)} of {count} dots, evenly chosen."
        found = replace(self, point=self.point[kept], x=self.x[kept], y=self.y[kept])
        return found.noting(note)

    def with_series(
        self,
        motions: int,
        series: Callable[[int], Series | None],
        *,
        chosen: Sequence[int] | None = None,
        group: NDArray[np.int64] | None = None,
    ) -> Page:
        """Return the page with time series of some of its points.

        Parameters
        ----------
        motions : int
            Largest number of points with time series.
        series : callable
            Returns the series of a point by number; None, or NoMotion, without a motion.
        chosen : sequence of int, optional
            The points, ascending; by default they are chosen evenly.
        group : (p,) array of int, optional
            A point shows the nearest series of its group; by default of its curve or region.
        """
        page, count = self, len(self.look)
        places = chosen[:motions] if chosen is not None else self._spread(motions)
        if chosen is None and 0 < len(places) < count:
            page = page.noting(
                f"{len(places)} of {count} points, evenly chosen, have time series in this file. "
                "The others show the nearest one."
            )
        found = {place: _motion(series, place) for place in places}
        kept = {place: one for place, one in found.items() if one is not None}
        if group is None:
            group = self.track if self.cells is None else self.cells.numbers.ravel()
        nearest = self._near(list(kept), group)
        return replace(page, series=list(kept.values()), owners=list(kept), nearest=nearest)

    def _spread(self, most: int) -> list[int]:
        """Return the numbers of at most `most` points, evenly chosen."""
        shape = (len(self.look),) if self.cells is None else self.cells.numbers.shape
        counts, left = [], most
        for axis, size in enumerate(shape):
            # the same density along each axis, relative to its length
            share = (left * size / np.prod(shape[axis + 1 :])) ** (1.0 / (len(shape) - axis))
            counts.append(min(max(round(share), 1), size, left))
            left //= max(counts[-1], 1)
        picks = [
            np.unique(np.linspace(0, size - 1, count).round().astype(int))
            for size, count in zip(shape, counts, strict=True)
        ]
        found: list[int] = np.sort(
            np.ravel_multi_index(np.meshgrid(*picks), shape).ravel()
        ).tolist()
        return found

    def _near(self, owners: Sequence[int], group: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return for each point the index of the nearest owner of its group, (p,); -1 without one.

        The distance is counted in points along a curve, or in rows and columns of a plane.
        """
        near, own = np.full(len(group), -1), np.array(owners, dtype=np.int64)
        # indices along a curve; rows and columns of a plane
        shape = group.shape if self.cells is None else self.cells.numbers.shape
        places = np.stack(np.unravel_index(np.arange(len(group)), shape), axis=1)
        for number in np.unique(group[own]).tolist():
            (there,) = np.nonzero(group == number)
            (mine,) = np.nonzero(group[own] == number)
            best = np.full(len(there), np.inf)
            for k in mine.tolist():
                away = ((places[there] - places[own[k]]) ** 2).sum(axis=1)
                near[there[away < best]] = k
                best = np.minimum(best, away)
        return near

    def over(self, below: Page) -> Page:
        """Return both pages in one diagram, this one drawn above the other.

        Raises
        ------
        ValueError
            When the axes differ, or one of the pages shows regions.
        """
        if self.cells is not None or below.cells is not None or self.names != below.names:
            pair = " and ".join(" against ".join(page.names[::-1]) for page in (below, self))
            raise ValueError(f"results must have the same axes and no regions; got {pair}")
        shift, tracks = len(below.look), int(below.track.max(initial=-1)) + 1
        near = np.where(self._nearest < 0, -1, self._nearest + len(below.series))
        names = dict.fromkeys([*below.facts, *self.facts])
        return Page(
            title=f"{self.title}; {below.title}",
            names=self.names,
            track=np.append(below.track, self.track + tracks),
            look=np.append(below.look, self.look),
            facts={name: [*_values(below, name), *_values(self, name)] for name in names},
            point=np.append(below.point, self.point + shift),
            x=np.append(below.x, self.x),
            y=np.append(below.y, self.y),
            lines=_joined(below.lines, self.lines),
            notes=[*below.notes, *self.notes],
            series=[*below.series, *self.series],
            nearest=np.append(below._nearest, near),
            owners=[*below.owners, *(place + shift for place in self.owners)],
        )


def _motion(series: Callable[[int], Series | None], place: int) -> Series | None:
    try:
        return series(place)
    except NoMotion:
        return None


def page_of_motions(
    title: str, names: tuple[str, str], count: int, point: NDArray[np.int64], x: Array, y: Array
) -> Page:
    """Return the page of points that are motions, on one track, without facts."""
    track, look = np.zeros((2, count), dtype=np.int64)
    return Page(title, names, track, look, {}, point, x, y)


def page_of_cells(
    title: str,
    names: tuple[str, str],
    axes_values: tuple[Array, Array],
    numbers: NDArray[np.int64],
    regions: Sequence[tuple[str, str]],
) -> Page:
    """Return a page of cells (k1, k2); only the regions that occur are named."""
    there, numbers = np.unique(numbers, return_inverse=True)
    cells = Cells(*axes_values, numbers, [regions[i] for i in there.tolist()])
    none, point = np.empty(0), np.empty(0, np.int64)
    return replace(page_of_motions(title, names, numbers.size, point, none, none), cells=cells)


def _joined(
    below: Mapping[str, tuple[Array, Array]], above: Mapping[str, tuple[Array, Array]]
) -> Mapping[str, tuple[Array, Array]]:
    """Return the lines of two pages; those of one look follow each other with a gap."""
    gap = np.array([np.nan])
    found = {**below, **above}
    for look in below.keys() & above.keys():
        pairs = zip(below[look], above[look], strict=True)
        x, y = (np.concatenate([first, gap, second]) for first, second in pairs)
        found[look] = x, y
    return found


def _values(page: Page, name: str) -> list[Any]:
    values = page.facts.get(name)
    return [""] * len(page.look) if values is None else list(values)


def _column(values: Any) -> Any:
    """Return a column of numbers as an array, and one of texts as codes with their names."""
    array = np.asarray(values)
    if array.dtype.kind in "fiu":
        return array.astype(np.float64)
    texts = ["" if value == "nan" else value for value in map(_text, values)]
    names = list(dict.fromkeys(texts))
    codes = {name: code for code, name in enumerate(names)}
    return {"codes": np.array([codes[text] for text in texts], np.int32), "names": names}


def _text(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _packed(series: Series) -> dict[str, Any]:
    return {
        "times": np.asarray(series.times, np.float32),
        "columns": {name: np.asarray(x, np.float32) for name, x in series.columns.items()},
        "shown": series.shown,
        "portrait": series.portrait,
        "discrete": series.discrete,
        "marks": series.marks,
        "machine": series.machine,
    }


def page_of_section(
    title: str,
    motion: Any,
    series: Callable[[int], Series],
    motions: int,
    look: str = "motion",
) -> Page:
    """Return the page of an attractor or an orbit: its states in the plane of its figures.

    Parameters
    ----------
    title : str
    motion : Attractor or PeriodicOrbit
        Something with a `system`, `states` and ``observable(name)``.
    series : callable
        Returns the time series of the whole motion; its argument has no effect.
    motions : int
        Without motions, the page has no time series.
    look : str
        One of `LOOKS`.
    """
    (across, x), (up, y) = _plane(motion)
    page = page_of_motions(title, (across, up), max(len(x), 1), np.arange(len(x)), x, y)
    page = replace(page, look=page.look + LOOKS.index(look))
    if len(x):
        page = replace(page, facts={"state": np.arange(float(len(x))), across: x, up: y})
    else:
        page = page.noting("The motion has no states on its section: the diagram is empty.")
    return page.with_series(motions, series, chosen=[0])


def _plane(motion: Any) -> list[tuple[str, Array]]:
    """Return names and columns of both axes of a section."""
    if names := motion.system._section_axes:
        return [(name, motion.observable(name)) for name in names]
    states = motion.states
    first, *others = motion.system.coordinates(states).items()
    if others:
        return [first, others[0]]
    beyond = [motion.system.image(state) for state in states[-1:]]
    return [first, (f"next {first[0]}", np.concatenate([*states[1:], *beyond]))]
