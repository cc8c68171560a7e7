"""What a picture shows, in words: written into each picture of a tutorial, and compared.

The pictures of a notebook are drawn in its kernel, which calls `describe_pictures` first. From then
on every PNG picture holds the words of `description` beside its points.
"""

from __future__ import annotations

import base64
import functools
import io
import re
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# Numbers, as in the label P(inf,2), hang on the processor where motions are chaotic.
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|inf")
# So does which motion of a chaotic sweep has not settled.
_UNSURE = {"unsettled"}
_COUNTS = {1: "one", 2: "two", 3: "three"}


def described(picture: str) -> str:
    """Return the description in a picture, PNG in base64; empty where there is none."""
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        return str(image.info.get("Description", ""))


def describe_pictures() -> None:
    """Write its `description` into every PNG picture that is written from now on."""
    from matplotlib.backend_bases import FigureCanvasBase

    plain = FigureCanvasBase.print_figure

    @functools.wraps(plain)
    def print_figure(self: FigureCanvasBase, file: Any, *args: Any, **settings: Any) -> Any:
        if (settings.get("format") or str(file)[-3:]) == "png":
            settings["metadata"] = {"Description": description(self.figure)}
        return plain(self, file, *args, **settings)

    FigureCanvasBase.print_figure = print_figure  # type: ignore[assignment,method-assign]


def description(figure: Figure) -> str:
    """Return what a figure shows, a line for each of its axes; numbers are #.

    Examples
    --------
    >>> from dynkit.plotting.figures import new_figure
    >>> figure, (axes,) = new_figure()
    >>> _ = axes.plot([0, 1], [0, 1], "--", label="table")
    >>> _ = axes.plot([0], [0], "o", label="impacts")
    >>> _ = axes.set_xlabel("time"), axes.text(0, 0, "P(1,3)")
    >>> description(figure)
    "time: one dashed 'table', one dots 'impacts'; texts P(#,#)"
    """
    return "\n".join(map(_axes, figure.axes))


def _axes(axes: Axes) -> str:
    drawn = Counter(_line(line) for line in axes.get_lines() if np.size(line.get_xydata()))
    drawn += Counter(type(shown).__name__ for shown in axes.collections)
    names = [axes.get_xlabel(), axes.get_ylabel(), axes.get_title()]
    legend = axes.get_legend()
    entries = [text.get_text() for text in legend.get_texts()] if legend else []
    parts = [
        ", ".join(
            f"{_COUNTS.get(count, 'several')} {what}" for what, count in sorted(drawn.items())
        ),
        _words("texts", (text.get_text() for text in axes.texts)),
        _words("legend", entries),
    ]
    return _plain("; ".join(filter(None, names))) + ": " + "; ".join(filter(None, parts))


def _words(name: str, texts: Iterable[str]) -> str:
    found = sorted({_plain(text) for text in texts} - _UNSURE - {""})
    return f"{name} {' '.join(found)}" if found else ""


def _plain(text: str) -> str:
    return _NUMBER.sub("#", text)


def _line(line: Line2D) -> str:
    label = str(line.get_label())
    return style(line) + ("" if label.startswith("_") else f" {_plain(label)!r}")


def style(line: Line2D) -> str:
    """Return how a line is drawn: as dots of data, solid, dashed, or dotted.

    A dotted line has no dash that is longer than the line is wide.
    """
    if line.get_linestyle() in ("none", "None", "", " "):
        return "dots"
    # the pattern in widths of the line, which no public method gives
    _, pattern = line._unscaled_dash_pattern  # type: ignore[attr-defined]
    if pattern is None:
        return "solid"
    return "dotted" if max(pattern[::2]) <= 1.0 else "dashed"


def overprinted(figure: Figure) -> list[tuple[str, str]]:
    """Return pairs of texts of a figure that are printed over each other.

    Texts overlap where their boxes have more than a point of width and height in common. An axis
    with an offset, such as ``1e-5`` at its end, is a pair of its name and that offset.
    """
    from matplotlib.text import Text

    figure.draw_without_rendering()
    point = figure.dpi / 72.0
    unseen: list[Text] = []
    found = []
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low <= tick.get_loc() <= high:
                    unseen += [tick.label1, tick.label2]
            if offset := axis.get_offset_text().get_text():
                found.append((axis.get_label_text(), offset))
    texts = [
        text
        for text in cast("list[Text]", figure.findobj(Text))
        if text.get_visible() and text.get_text().strip() and not any(text is one for one in unseen)
    ]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    for k, (one, box) in enumerate(boxes):
        for other, beside in boxes[k + 1 :]:
            wide = min(box.x1, beside.x1) - max(box.x0, beside.x0)
            high = min(box.y1, beside.y1) - max(box.y0, beside.y0)
            if min(wide, high) > point:
                found.append((one, other))
    return found
