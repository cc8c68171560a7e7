"""Error against run time of dynkit and of SciPy's integrators.

The first impacts of a chain are compared.

Errors are differences from dynkit's most accurate impacts, whose estimated
error is drawn as a band; points in the band are not significant. Options may
also be in a TOML file, under the same names; the command line overrides the
file.

For instance:
  dynkit work-precision --masses 2 --frequency 0.87 --impacts 10 --out error-time.png
  dynkit work-precision --config mine.toml --out error-time.pdf
  dynkit work-precision --config mine.toml --out error-time.csv

mine.toml may hold:
  masses = 3
  frequency = 0.9
  impacts = 5
  methods = ["dynkit", "DOP853", "LSODA"]
"""

from __future__ import annotations

from functools import partial

from dynkit.analysis.work_precision.measurement import cells
from dynkit.analysis.work_precision.measuring import WorkPrecision
from dynkit.analysis.work_precision.standard_methods import NAMES, impact_methods
from dynkit.cli.options import SYSTEM, Asked, Option, options_of
from dynkit.cli.output import OUT, aligned, files_of, plotted, print_summary, write

OPTIONS = (
    *SYSTEM,
    *options_of(WorkPrecision.of, "impacts", "progress"),
    Option("methods", "NAME,...", f"methods among {', '.join(NAMES)} (all)"),
    OUT,
)
_COLUMNS = ("method", "tolerance", "error", "seconds", "work", "remark")


def run(asked: Asked) -> None:
    """Measure, draw, and print a table: the columns of `WorkPrecision.table` that fit 80 letters.

    Raises
    ------
    ValueError
        When an option is refused; no file has been written then.
    """
    methods = impact_methods(asked.names("methods", NAMES, NAMES))
    _, file = files_of(asked)
    chain = asked.chain()
    options = {"start": asked.start(chain), **asked.only("impacts", "progress")}
    measured = WorkPrecision.of(chain, methods=methods, **options)
    rows = [cells(one) for one in measured]
    if file:
        write(file, partial(plotted, measured, height=3.2), measured.dataset())
    shown = {
        "system": next(iter(measured.jobs)),
        "error of the reference": f"{measured.error:.1e} (smaller errors mean nothing)",
        "seconds": f"{measured.cost.seconds:.1f}",
    }
    print_summary(shown, file)
    print("", *aligned([_COLUMNS, *([row[name] for name in _COLUMNS] for row in rows)]), sep="\n")
