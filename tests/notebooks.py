"""The tutorials as notebooks: execute them, and keep their outputs free of noise.

``python -m tests.notebooks`` executes all, or those that are named, and writes what
they put out into them.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import TYPE_CHECKING, Any

from tests.pictures import described

if TYPE_CHECKING:
    from nbformat import NotebookNode

FOLDER = Path(__file__).parents[1] / "tutorials"

STATISTICS = "statistics"
"""Tag of cells whose numbers are statistics of chaos: other processors give others."""

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_AVERAGE = re.compile(rf"({_NUMBER.pattern}) \+- ({_NUMBER.pattern})")
# Seconds are kept for long enough to compile kernels on a slow machine.
_TIMEOUT = 600
# The kernel takes dynkit and the tests from here.
_FIRST = f"""
import sys
sys.path.insert(0, {str(FOLDER.parent)!r})
from tests import pictures
pictures.describe_pictures()
"""
TIMED_ONCE = """
from tests.benchmarks import report
report.time_once()
"""
"""For tests, which compare no times."""


@dataclass(frozen=True)
class CellText:
    """What a code cell printed: its words and its numbers apart, and what its figures show.

    Of statistics, averages and their standard errors, printed as ``value +- error``, stand apart
    from other numbers.
    """

    cell: str
    words: str
    numbers: tuple[float, ...]
    averages: tuple[tuple[float, float], ...]
    figures: tuple[str, ...]
    statistics: bool


def notebooks() -> list[Path]:
    """All tutorials, in their order."""
    return sorted(FOLDER.glob("*.ipynb"))


def read(path: Path) -> NotebookNode:
    """A notebook as it stands."""
    import nbformat

    notebook: NotebookNode = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    nbformat.validate(notebook)
    return notebook


@contextmanager
def executing(
    pictures: str = "png", first: str = ""
) -> Iterator[Callable[[NotebookNode], NotebookNode]]:
    """Start a kernel, in which notebooks are executed from their first cells to their last.

    Pictures are "png", or "retina" with twice the points. The kernel runs the code `first` once.

    Each finds no names of others, and has a folder of its own. To start a kernel and to import what
    all of them need takes longer than most of them.
    """
    import nbformat
    from nbclient import NotebookClient
    from traitlets.config import Config

    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    new: Any = nbformat.v4
    with TemporaryDirectory() as home:
        client = NotebookClient(
            new.new_notebook(),
            timeout=_TIMEOUT,
            extra_arguments=[
                f"--InlineBackend.figure_formats={{{pictures!r}}}",
                f"--IPKernelApp.exec_lines={_FIRST + first}",
            ],
            kernel_name="python3",
            config=Config(
                {
                    "KernelManager": {
                        "transport": "ipc",
                        "ip": f"{home}/kernel",
                        "shutdown_wait_time": 0.0,
                    }
                }
            ),
            resources={"metadata": {"path": home}},
        )

        def execute(notebook: NotebookNode) -> NotebookNode:
            fresh = new.new_code_cell(f"%reset -f\n%cd -q {mkdtemp(dir=home)}")
            client.nb = new.new_notebook(cells=[fresh])
            client.execute()
            client.nb = notebook
            return client.execute()

        # a client ends only a kernel that it made
        client.km, client.owns_km = client.create_kernel_manager(), False
        with client.setup_kernel(cleanup_kc=True):
            yield execute


def without_noise(notebook: NotebookNode) -> NotebookNode:
    """Leave out what changes from run to run: times, and what the machine is called."""
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    count = 0
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type != "code":
            continue
        count += 1
        cell.execution_count = count
        for output in cell.outputs:
            if "execution_count" in output:
                output.execution_count = count
    return notebook


def texts(notebook: NotebookNode) -> list[CellText]:
    """What each code cell put out."""
    return [_text(cell) for cell in notebook.cells if cell.cell_type == "code"]


def _text(cell: Any) -> CellText:
    text = ""
    figures = []
    for output in cell.outputs:
        if output.output_type == "stream":
            text += output.text
        else:
            picture = output.data.get("image/png")
            figures += [described(picture)] if picture else []
            text += "" if picture else output.data.get("text/plain", "")
    statistics = STATISTICS in cell.metadata.get("tags", ())
    rest = _AVERAGE.sub("+-", text) if statistics else text
    averages = _AVERAGE.findall(text) if statistics else []
    return CellText(
        cell.id,
        _NUMBER.sub("#", rest),
        tuple(float(number) for number in _NUMBER.findall(rest)),
        tuple((float(value), float(error)) for value, error in averages),
        tuple(figures),
        statistics,
    )


def refresh(paths: Iterable[Path]) -> None:
    """Execute notebooks and write them with their outputs."""
    import nbformat

    with executing("retina") as execute:
        for path in paths:
            notebook = without_noise(execute(read(path)))
            nbformat.write(notebook, path)  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    refresh(map(Path, sys.argv[1:]) if sys.argv[1:] else notebooks())
