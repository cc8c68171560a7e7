"""All benchmarks, as Markdown tables; they write ``docs/benchmarks.md``. Run by ``make bench``.

Ratios within one run are what may be compared. Nothing here is asserted.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from string import Template

import numba
import numpy as np

from dynkit.plotting.figures import write_figure
from tests.benchmarks.continuation import continuation
from tests.benchmarks.dimension import dimensions
from tests.benchmarks.extremes import extremes
from tests.benchmarks.extremes.table import selection, summary
from tests.benchmarks.flows import flows
from tests.benchmarks.impacts import impacts
from tests.benchmarks.lyapunov import lyapunov_speed
from tests.benchmarks.machines import machines
from tests.benchmarks.report import HEAD, Line, by_job, in_turns, markdown
from tests.benchmarks.scaling import scaling
from tests.benchmarks.structures import structures
from tests.benchmarks.symbols import symbols
from tests.benchmarks.work_precision import work_precision

DOCS = Path(__file__).parents[2] / "docs"
RESOLUTION = 200.0
"""Of the figures, in dots per inch."""

PAGE, TEMPLATE = DOCS / "benchmarks.md", Path(__file__).with_name("page.md")


def start_up() -> Iterator[Line]:
    """Seconds of whole processes."""
    simulate = (
        "from dynkit.systems import ImpactChain; ImpactChain(frequency=0.87).simulate(impacts=100)"
    )
    codes = "pass", "import dynkit", "import numba, scipy.linalg", simulate, simulate
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        seconds = [
            in_turns(
                partial(subprocess.run, [sys.executable, "-c", code], env=environment, check=True),
                runs=1,
            )[0]
            for code in codes
        ]
    python, imported, libraries, first, second = seconds
    yield Line("process: `import dynkit`", imported, "Python alone", python)
    yield Line("process: a simulation", second, "import of Numba and SciPy", libraries)
    yield Line("process: first simulation of a fresh install", first, "the same again", second)


def machine() -> str:
    """Return a sentence on when and with what the page was measured."""
    processor = platform.processor() or platform.machine()
    if (described := Path("/proc/cpuinfo")).exists():
        names = [line for line in described.read_text().splitlines() if "model name" in line]
        processor = names[0].partition(":")[2].strip() if names else processor
    programs = f"Python {platform.python_version()}, NumPy {np.__version__}"
    today = f"{datetime.now(UTC):%d %B %Y}"
    return (
        f"Measured {today} on one of {os.cpu_count()} processors ({processor}), "
        f"with {programs} and Numba {numba.__version__}."
    )


def unbroken(text: str) -> str:
    """Return the text without a line's end between a number and its unit."""
    return re.sub(r"(?<=\d) (?=(µs|ms|s)\b)", "\u00a0", text)


def one_table(rows: list[Sequence[str]]) -> None:
    """Print the one table line by line, and collect its rows."""
    print(markdown(HEAD, []), flush=True)
    for part in (
        *(impacts, structures, continuation, lyapunov_speed),
        *(dimensions, symbols, scaling, start_up),
    ):
        for line in part():
            rows.append(line.cells())
            print(f"| {' | '.join(rows[-1])} |", flush=True)


def main() -> None:
    """Measure, print, and write the page and its figures."""
    rows: list[Sequence[str]] = []
    one_table(rows)
    figure = DOCS / "_static" / "error-time.png"
    measured = work_precision(log=sys.stdout)
    write_figure("figure", figure, measured.figure(), RESOLUTION)
    found = extremes(log=sys.stdout)
    texts = {
        "machine": machine(),
        "lines": markdown(HEAD, rows),
        "impacts": by_job(measured, finest=True),
        "machines": by_job(machines()),
        "flows": by_job(flows(figure.with_name("error-time-flows.png"), RESOLUTION)),
        "extremes": selection(found),
        "extremes_summary": summary(found),
    }
    for name in ("machines", "flows"):
        print(f"\n{texts[name]}")
    PAGE.write_text(unbroken(Template(TEMPLATE.read_text("utf-8")).substitute(texts)), "utf-8")
    print(f"written: {PAGE}")


if __name__ == "__main__":
    main()
