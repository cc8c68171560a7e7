"""The file of a page: plotly.js, the page's script and style, and its data, in one text."""

from __future__ import annotations

import json
from base64 import b64encode
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from dynkit._version import __version__

MISSING = "view needs plotly, which is not installed: pip install 'dynkit[view]'"
_TYPES = {"float32": "f4", "float64": "f8", "int32": "i4"}


def refuse_without_plotly() -> None:
    """Raise ImportError when plotly is not installed."""
    if find_spec("plotly") is None:
        raise ImportError(MISSING)


def html_of(title: str, data: Any) -> str:
    """Return the page with a title and data; arrays become base64, little-endian.

    Raises
    ------
    ImportError
        When plotly is not installed.
    """
    refuse_without_plotly()
    from plotly.offline import get_plotlyjs

    # escape "<": a text of the data must not end the HTML element that contains it
    packed = json.dumps(data, default=_plain).replace("<", "\\u003c")
    parts = {
        "title": escape(title),
        "version": escape(__version__),
        "style": _file("page.css"),
        "data": packed,
        "script": _file("page.js"),
        "plotly": get_plotlyjs(),
    }
    head, *rest = _file("page.html").split("{{")
    for piece in rest:  # one pass: a part may contain braces
        name, _, text = piece.partition("}}")
        head += parts[name] + text
    return head


def _file(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _plain(value: Any) -> Any:
    array = np.asarray(value)
    kind = _TYPES[array.dtype.name]
    return {"dtype": kind, "bdata": b64encode(array.astype(f"<{kind}").tobytes()).decode("ascii")}
