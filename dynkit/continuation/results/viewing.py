"""Pages of branches and networks for the browser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.bifurcations.kinds import KINDS
from dynkit.continuation.results.lines import Line, curves_of, kinds_of, nodes_of
from dynkit.core.reprs import written
from dynkit.core.validation import Array
from dynkit.viewer.page import LOOKS, Page

if TYPE_CHECKING:
    from dynkit.viewer.series import Series

_WITHOUT = (
    "The result was loaded without an orbit of each label. Curves without one show the largest "
    "modulus of the spectrum, and there are no time series of their points."
)
_WITHOUT_ORBITS = "The result was loaded without an orbit: there are no time series."
_SPECTRUM = "largest modulus of the spectrum"
# Largest number of multipliers in the text of a point.
_MULTIPLIERS = 4


def page_of(title: str, branches: Sequence[Any], y: str | None, motions: int) -> Page:
    """Return the page of branches, with time series of at most `motions` points.

    The diagram shows the observable `y`, by default the first. Points and bifurcations of branches
    are points of the page, in the order of the curve.
    """
    known = all(branch._problem is not None for branch in branches)
    lines = [branch._line(y) if known else _spectra(branch) for branch in branches]
    look = [_looks(branch, line) for branch, line in zip(branches, lines, strict=True)]
    rows = np.concatenate([np.arange(len(line.nodes)) for line in lines])
    track = np.repeat(np.arange(len(lines)), [len(line.nodes) for line in lines])
    columns = [line.y.shape[1] for line in lines for _ in line.nodes]
    heights = np.concatenate([line.y.astype(float).ravel() for line in lines])
    drawn = ~np.isnan(heights)
    point = np.repeat(np.arange(len(columns)), columns)[drawn]
    values = np.concatenate([line.x for line in lines])
    said = [
        _facts(branch, place, b)
        for branch, line in zip(branches, lines, strict=True)
        for place, b in line.nodes
    ]
    facts = {
        name: [row.get(name, "") for row in said]
        for name in dict.fromkeys(name for row in said for name in row)
    }
    page = Page(
        title=title,
        names=lines[0].names,
        track=track,
        look=np.concatenate(look),
        facts={lines[0].names[0]: values, **facts},
        point=point,
        x=values[point],
        y=heights[drawn],
        lines=curves_of(lines),
    )
    if not known:
        return page.noting(_WITHOUT)

    def series(at: int) -> Series | None:
        branch = branches[track[at]]
        place, b = lines[track[at]].nodes[rows[at]]
        orbit = branch.orbit(int(place)) if b is None else b.orbit
        found: Series | None = orbit._series()
        return found

    return page.with_series(motions, series)


def page_of_curve(curve: Any, motions: int) -> Page:
    """Return the page of a curve of bifurcations in the plane of its two parameters.

    At most `motions` points have time series.
    """
    count, known = len(curve), curve._problem is not None
    x, y = curve.parameters.T
    looks = ("inadmissible bifurcation", "bifurcation")
    page = Page(
        title=f"Curve of {curve.kind} of {curve.label}",
        names=curve.names,
        track=np.zeros(count, dtype=np.int64),
        look=np.array([LOOKS.index(looks[fine]) for fine in curve.admissible.astype(int)]),
        facts={
            **curve._free,
            "label": [curve.label] * count,
            "kind": [f"{curve.kind}, {KINDS[curve.kind].title}"] * count,
            "admissible": ["yes" if fine else "no" for fine in curve.admissible],
            "error": [f"{error:.1e}" for error in curve.error],
        },
        point=np.arange(count),
        x=x,
        y=y,
        lines={"bifurcation": (x, y)},
    )
    return (
        page.with_series(motions, lambda at: curve.orbit(at)._series())
        if known
        else page.noting(_WITHOUT_ORBITS)
    )


def _spectra(branch: Any) -> Line:
    """Return the line of a branch without orbits: the largest modulus of its spectrum."""
    nodes = nodes_of(len(branch), branch.bifurcations)
    moduli = abs(branch.multipliers).max(axis=1)
    places = np.arange(len(branch))
    x = [branch.parameter[int(place)] if b is None else b.value for place, b in nodes]
    y = np.interp([place for place, _ in nodes], places, moduli)[:, None]
    kinds = kinds_of(nodes, branch.stable, branch.admissible)
    return Line((branch.name, _SPECTRUM), nodes, np.array(x), y, kinds, branch.label)


def _looks(branch: Any, line: Line) -> Array:
    names = [
        _kind(branch, int(place))
        if b is None
        else "bifurcation"
        if b.admissible
        else "inadmissible bifurcation"
        for place, b in line.nodes
    ]
    return np.array([LOOKS.index(name) for name in names])


def _kind(branch: Any, place: int) -> str:
    if not branch.admissible[place]:
        return "inadmissible"
    return "stable" if branch.stable[place] else "unstable"


def _error(branch: Any, at: int) -> float:
    known = branch._problem is not None or "error" in vars(branch)
    return float(branch.error[at]) if known else float("nan")


def _facts(branch: Any, place: float, b: Any) -> dict[str, Any]:
    """Return the texts shown for a point, or for a bifurcation, of a branch."""
    if b is not None:
        numbers = [] if b.multiplier is None else [b.multiplier]
        kind, admissible, error = f"{b.kind}, {KINDS[b.kind].title}", b.admissible, b.error
    else:
        at = int(place)
        numbers, admissible = list(branch.multipliers[at]), bool(branch.admissible[at])
        kind, error = "stable" if branch.stable[at] else "unstable", _error(branch, at)
    more = ", ..." if len(numbers) > _MULTIPLIERS else ""
    texts = [written(complex(f"{complex(m):.6g}")) for m in numbers[:_MULTIPLIERS]]
    return {
        "label": branch.label,
        "kind": kind,
        "multipliers" if branch.spectrum.periodic else "eigenvalues": ", ".join(texts) + more,
        "admissible": "yes" if admissible else "no",
        "error": f"{error:.1e}" if error == error else "",
    }
