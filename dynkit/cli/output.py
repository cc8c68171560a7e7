"""Output files of a run: checked before it begins, written completely or not at all."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from dynkit.cli.options import Option
from dynkit.data.atomic_files import locked, place, whole
from dynkit.data.dataset import ENDINGS as DATA, Dataset
from dynkit.plotting.figures import PICTURES, new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (*DATA, *PICTURES)
OUT = Option("out", "FILE", f"file to write, in the format of its ending: {', '.join(ENDINGS)}")

_MOST_LABELS = 12


def files_of(
    asked: Mapping[str, Any], endings: tuple[str, ...] = ENDINGS
) -> tuple[Path | None, Path | None]:
    """Return the paths of the store and the output file after checks, without writing.

    Raises
    ------
    ValueError
        When an ending is unknown, one of them cannot be written, or both are the same.
    """
    store, out = asked.get("store"), asked.get("out")
    kept = None if store is None else output_file("store", store)
    file = None if out is None else output_file("out", out, endings)
    if file and kept and file.resolve() == kept.resolve():
        raise ValueError(f"out must be another file than store; got {out!r}")
    return kept, file


def output_file(name: str, text: str, endings: tuple[str, ...] = ()) -> Path:
    """Return the path of an output file after checks, without writing.

    Raises
    ------
    ValueError
        When its ending is not among the endings, or it cannot be written.
    """
    path = Path(text)
    if endings and path.suffix not in endings:
        raise ValueError(f"{name} must end in {', '.join(endings)}; got {text!r}")
    try:
        if path.is_dir():
            raise ValueError(f"{name} must be a file; got the folder {str(path)!r}")
        if path.is_file():
            with path.open("rb+"):
                pass
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as failure:
        raise ValueError(
            f"{name} must be writable; got {str(path)!r} ({failure.strerror})"
        ) from failure
    with locked(name, place(name, path)):
        return path


class _Plotted(Protocol):
    def plot(self, ax: Axes) -> Axes: ...


def plotted(found: _Plotted, height: float = 2.6) -> Figure:
    """Return a figure of a result."""
    figure, (axes,) = new_figure(height=height)
    found.plot(axes)
    return figure


def write(path: Path, draw: Callable[[], Figure], data: Dataset) -> None:
    """Write a picture or the dataset, depending on the ending of the path."""
    if path.suffix in PICTURES:
        write_figure("out", path, draw())
    else:
        with whole("out", path) as stream:
            stream.write(data.as_bytes(path.suffix))


# --- printed summaries ----------------------------------------------------------------------------


def print_summary(shown: Mapping[str, object], *files: Path | None) -> None:
    """Print names and values in two columns, and the written files."""
    written = ", ".join(str(file) for file in files if file)
    lines = {**shown, **({"written": written} if written else {})}
    print(*aligned((name, str(text)) for name, text in lines.items()), sep="\n")


def aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return rows as lines of columns.

    Examples
    --------
    >>> aligned([("label", "P(1,3)"), ("ending", "none")])
    ['label   P(1,3)', 'ending  none']
    """
    table = list(rows)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]


def counted(labels: Iterable[str]) -> str:
    """Return the labels with their counts, the most frequent first.

    Examples
    --------
    >>> counted(["P(1,3)", "chaotic", "P(1,3)"])
    'P(1,3) 2, chaotic 1'
    """
    counts = Counter(labels).most_common()
    words = [f"{label} {count}" for label, count in counts[:_MOST_LABELS]]
    words += [f"{len(counts) - _MOST_LABELS} more"] if counts[_MOST_LABELS:] else []
    return ", ".join(words)
