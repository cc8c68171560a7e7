"""Sketches of machines: masses, springs and dashpots, stops and friction."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import ink, print_style, shown_axes
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.records.event_counts import element_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap

_HALF, MASS_DISTANCE, _TOP = 0.4, 2.4, 1.1
"""Half the side of a mass; distance from one mass to the next; height of the walls above masses."""

ROOM = MASS_DISTANCE - 2.0 * _HALF
"""Free distance between two masses."""

_LANES, _LANE = -0.95, 0.75
"""Height of the first row of elements, and distance from one row to the next."""

_SCALE, _WIDEST, _LETTER = 0.32, 7.0, 0.063
"""In inches: a unit of the sketch, the largest width, the width of a letter."""

_MOST, _NONE = 20, 1e-9


class Pose(NamedTuple):
    """A position of a machine, in units of the sketch.

    Attributes
    ----------
    shift : (N,)
        Displacements of the masses.
    gaps : dict of str to float
        Gaps of stops, and stretches of springs to sliders, by name; others have a fixed size.
    struck : dict of str to float
        Numbers from 1, for a stop that was just hit, down to 0, by name.
    stuck : collection of str
        Names of friction elements that stick.
    margin : float
        Smallest horizontal position at which the names of elements begin.
    """

    shift: Array
    gaps: Mapping[str, float]
    struck: Mapping[str, float]
    stuck: Collection[str]
    margin: float


@print_style()
def sketch(ax: Axes | None, system: ImpactMap, pose: Pose | None = None) -> Axes:
    """Draw a machine, in a pose if one is given; see `ImpactOscillator.plot`."""
    from matplotlib.figure import Figure

    n = system.degrees_of_freedom
    if n > _MOST:
        raise ValueError(f"degrees_of_freedom must not exceed {_MOST} in a sketch; got {n}")
    axes = shown_axes(ax)
    pen = _Pen(axes, n, pose or Pose(np.zeros(n), {}, {}, (), -math.inf))
    for k in range(n):
        pen.mass(k)
    for matrix, kind in ((system.stiffness, "spring"), (system.damping_matrix, "dashpot")):
        least = _NONE * abs(matrix).max(initial=0.0)
        for i in range(n):
            if abs(matrix[i].sum()) > least:
                pen.to_wall(kind, i)
            for j in range(i + 1, n):
                if abs(matrix[i, j]) > least:
                    pen.between(kind, i, j)
    named = zip(element_names(system), system._elements, strict=True)
    # Surfaces are last: no other element of the same mass is drawn below them.
    for name, element in sorted(named, key=lambda pair: "sticks" in pair[1].doing):
        pen.element(name, element)
    axes.set_aspect("equal")
    axes.margins(0.02, 0.05)
    axes.axis("off")
    if ax is None:
        figure = axes.figure
        assert isinstance(figure, Figure)
        width, height = (high - low for low, high in (axes.get_xlim(), axes.get_ylim()))
        scale = min(_SCALE, _WIDEST / width)
        figure.set_layout_engine("none")
        figure.set_size_inches(scale * width, scale * height)
        axes.set_position((0.0, 0.0, 1.0, 1.0))
    return axes


@final
class _Pen:
    """Draws masses side by side; positive displacements are to the right."""

    def __init__(self, ax: Axes, size: int, pose: Pose) -> None:
        self._ax, self._last, self._pose = ax, size - 1, pose
        self._lanes: list[list[tuple[float, float]]] = []
        self._letter = _LETTER / min(_SCALE, _WIDEST / (MASS_DISTANCE * size))

    # --- strokes ----------------------------------------------------------------------------------

    def _line(self, x: Any, y: Any, **look: Any) -> None:
        self._ax.plot(x, y, **{"color": ink(), "linewidth": 0.8, **look})

    def _box(self, x: float, y: float, width: float, height: float, **look: Any) -> None:
        from matplotlib.patches import Rectangle

        usual = {"facecolor": ink(1.0), "edgecolor": ink(), "linewidth": 0.8, "zorder": 3}
        self._ax.add_patch(Rectangle((x, y), width, height, **{**usual, **look}))

    def _text(self, x: float, y: float, text: str, **look: Any) -> None:
        usual = {"ha": "center", "va": "center", "fontsize": 7.0, "zorder": 4}
        self._ax.text(x, y, text, **{**usual, **look})

    def _wall(self, x: float, y: float, width: float, height: float) -> None:
        self._box(x, y, width, height, hatch="//////", linewidth=0.0, edgecolor=ink(0.4))

    def _link(self, kind: str, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a spring or a dashpot from one point to another."""
        a, b = np.array(start), np.array(end)
        along = (b - a) / np.hypot(*(b - a))
        across = 0.1 * np.array([-along[1], along[0]])
        if kind == "spring":
            bends = np.array([0, 0, 1, -1, 1, -1, 1, -1, 0, 0])
            places = np.array([0.0, 0.2, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.8, 1.0])
            self._line(*(a + np.outer(places, b - a) + np.outer(bends, across)).T)
            return
        middle = 0.5 * (a + b)
        rim = [middle + 0.12 * along + side * across for side in (1.0, -1.0)]
        cup = [rim[0], *(middle - 0.12 * along + side * across for side in (1.0, -1.0)), rim[1]]
        self._line(*np.array([a, middle - 0.12 * along]).T)
        self._line(*np.array(cup).T)
        self._line(*np.array([middle - 0.6 * across, middle + 0.6 * across]).T)
        self._line(*np.array([middle, b]).T)

    def _arrow(self, x: float, y: float, velocity: float) -> None:
        """Draw an arrow in the direction of a velocity; a double arrow if the velocity is zero."""
        back = -0.3 if velocity < 0.0 else 0.3
        look = {"arrowstyle": "->" if velocity else "<->", "linewidth": 0.7, "color": ink()}
        look |= {"shrinkA": 0.0, "shrinkB": 0.0}
        self._ax.annotate("", (x + back, y), (x - back, y), arrowprops=look)

    # --- the structure ----------------------------------------------------------------------------

    def _at(self, k: int) -> float:
        """Horizontal position of a mass."""
        return k * MASS_DISTANCE + float(self._pose.shift[k])

    def mass(self, k: int) -> None:
        """Draw a mass as a box with its number."""
        self._box(self._at(k) - _HALF, -_HALF, 2.0 * _HALF, 2.0 * _HALF)
        if self._last < 12:
            self._text(self._at(k), 0.0, f"$x_{{{k + 1}}}$")
        else:
            self._text(self._at(k), 0.0, f"{k + 1}", fontsize=5.0)

    def to_wall(self, kind: str, k: int) -> None:
        """Draw a spring or dashpot from a mass to a wall, at its free side or above it."""
        off = 0.2 if kind == "spring" else -0.1
        home, x = k * MASS_DISTANCE, self._at(k)
        if 0 < k < self._last:
            self._link(kind, (x + off + 0.05, _HALF), (home + off + 0.05, _TOP))
            self._wall(home - 0.17, _TOP, 0.55, 0.2)
            self._line([home - 0.17, home + 0.38], [_TOP, _TOP])
            return
        side = -1.0 if k == 0 else 1.0
        edge, end = x + side * _HALF, home + side * (MASS_DISTANCE - _HALF)
        self._link(kind, (edge, off), (end, off))
        self._wall(end if side > 0.0 else end - 0.2, -_HALF, 0.2, 2.0 * _HALF)
        self._line([end, end], [-_HALF, _HALF])

    def between(self, kind: str, i: int, j: int) -> None:
        """Draw a spring or dashpot between two masses: straight, or above the masses in between."""
        off = 0.2 if kind == "spring" else -0.1
        start, end = self._at(i), self._at(j)
        if j == i + 1:
            self._link(kind, (start + _HALF, off), (end - _HALF, off))
            return
        y, off = _TOP + 0.35 * (j - i) + off, -0.28 - 0.3 * off
        for x in (start + off, end + off):
            self._line([x, x], [_HALF, y])
        self._link(kind, (start + off, y), (end + off, y))

    # --- elements ---------------------------------------------------------------------------------

    def element(self, name: str, element: Element) -> None:
        """Draw a stop or friction, with its name, below the masses on which it acts."""
        row = np.ones(self._last + 1) if element.curved else element.row(self._last + 1)
        some = np.flatnonzero(row).tolist()
        low, high = (k * MASS_DISTANCE for k in (some[0], some[-1]))
        pair, rubs = sorted(row[row != 0.0].tolist()) == [-1.0, 1.0], "sticks" in element.doing
        back, ahead = (0.0, 0.0) if pair else (0.8, 0.8) if rubs else (0.9, 0.0)
        if _by(element) is None and not (pair or rubs):
            back = 0.6
        if element.slider and not pair:
            ahead += 0.7
        if element.sign < 0 and not rubs:
            back, ahead = ahead, back
        end = max(high + ahead + 0.15, self._pose.margin)
        y = self._lane(low - back, end + self._letter * len(name))
        self._text(end, y, name.replace("_", " "), ha="left")
        look = "-" if pair or low == high else ":"
        for k in some:
            self._line([self._at(k)] * 2, [-_HALF, y], linestyle=look)
        home, (low, high) = low, (self._at(k) for k in (some[0], some[-1]))
        gap, hit = self._pose.gaps.get(name), self._pose.struck.get(name, 0.0)
        if not pair:
            self._line([low, high], [y, y])
        if rubs:
            fill = {"facecolor": ink(0.5)} if name in self._pose.stuck else {}
            if pair:
                self._rub(low, high, y, "spring" if element.slider else None, fill)
            else:
                self._surface(low, home, y, gap, element, fill)
        elif pair:
            stretched = element.sign * row[some[-1]] < 0.0
            (self._cage if stretched else self._stop)(low, high, y, gap, hit, _by(element))
        else:
            self._post(low if element.sign > 0 else high, y, gap, hit, element)

    def _lane(self, begin: float, end: float) -> float:
        """Height of a row of elements in which this horizontal interval is free."""
        for lane in self._lanes:
            if all(end < low or begin > high for low, high in lane):
                lane.append((begin, end))
                break
        else:
            self._lanes.append([(begin, end)])
        y = _LANES - _LANE * next(k for k, lane in enumerate(self._lanes) if (begin, end) in lane)
        self._ax.update_datalim([(begin, y - 0.4), (end, y)])
        return y

    def _plate(self, x: float, y: float, hit: float = 0.0) -> None:
        self._line([x, x], [y - 0.16, y + 0.16], linewidth=2.0 + 4.0 * hit)

    def _post(self, x: float, y: float, gap: float | None, hit: float, element: Element) -> None:
        """Draw a wall beside the stopped mass; a soft stop has a spring or dashpot at the wall."""
        side, by, apart = -element.sign, _by(element), 0.25 if gap is None else gap
        face, wall = x + max(apart, 0.0) * side, x + (apart + (0.45 if by else 0.0)) * side
        self._plate(x, y, hit)
        self._plate(face, y, hit)
        if by and wall != face:
            self._link(by, (wall, y), (face, y))
        self._wall(min(wall, wall + 0.2 * side), y - 0.22, 0.2, 0.44)
        self._line([wall, wall], [y - 0.22, y + 0.22])
        if element.amplitude:
            self._arrow(wall + 0.1 * side, y - 0.33, 0.0)

    def _surface(
        self, x: float, home: float, y: float, gap: float | None, element: Element, fill: Any
    ) -> None:
        """Draw a slider, possibly behind a spring, and the fixed surface below it."""
        if element.slider:
            x, start, home = x + 0.7 - (gap or 0.0), x, home + 0.7
            self._link("spring", (start, y), (x - 0.3, y))
        self._box(x - 0.3, y - 0.12, 0.6, 0.2, **fill)
        self._line([home - 0.8, home + 0.8], [y - 0.12] * 2)
        self._wall(home - 0.8, y - 0.26, 1.6, 0.14)
        if element.amplitude or element.drift:
            self._arrow(home, y - 0.36, 0.0 if element.amplitude else element.drift)

    def _stop(
        self, low: float, high: float, y: float, gap: float | None, hit: float, by: str | None
    ) -> None:
        """Draw a stop between two masses that is hit when they approach each other."""
        half = 0.12 if gap is None else 0.5 * max(gap, 0.0)
        left, right = (0.5 * (low + high) + side * half for side in (-1.0, 1.0))
        self._rod(low, left, y, by)
        self._line([right, high], [y, y])
        self._plate(left, y, hit)
        self._plate(right, y, hit)

    def _cage(
        self, low: float, high: float, y: float, gap: float | None, hit: float, by: str | None
    ) -> None:
        """Draw a stop that is hit when two masses move apart: a rod with a plate, in a cage."""
        left, right = (0.5 * (low + high) + side * 0.3 for side in (-1.0, 1.0))
        plate = right - (0.25 if gap is None else max(gap, 0.0))
        self._rod(low, plate, y, by)
        self._plate(plate, y, hit)
        for side in (-1.0, 1.0):
            x, up = [left, left, right, right], [0.06, 0.24, 0.24, 0.0]
            self._line(x, [y + side * height for height in up], linewidth=1.2)
        self._line([right, high], [y, y])

    def _rod(self, start: float, end: float, y: float, by: str | None) -> None:
        if by:
            self._link(by, (start, y), (end, y))
        else:
            self._line([start, end], [y, y])

    def _rub(self, low: float, high: float, y: float, by: str | None, fill: Any) -> None:
        """Draw friction between two masses, of which one slides along the other."""
        middle = 0.5 * (low + high)
        self._box(middle - 0.3, y - 0.12, 0.6, 0.24, **fill)
        self._rod(low, middle - 0.3, y, by)
        self._line([middle - 0.6, high, high], [y - 0.12, y - 0.12, y])
        self._wall(middle - 0.6, y - 0.26, 1.2, 0.14)


def _by(element: Element) -> str | None:
    """Symbol of a soft stop, "spring" or "dashpot"; None for other elements."""
    if "presses" not in element.doing:
        return None
    return "spring" if any(regime.stiffness for regime in element.regimes) else "dashpot"
