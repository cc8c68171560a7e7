"""A sweep of one parameter.

The motion at each value starts from the last state of the value before.

Options may also be in a TOML file, under the same names; the command line
overrides the file. With --store every finished value is kept, and the same
command resumes.

For instance:
  dynkit sweep --from 0.86 --to 0.88 --step 0.01 --out diagram.png
  dynkit sweep --parameter restitution --values 0.7,0.8,0.9 --frequency 0.87 --out sweep.csv
  dynkit sweep --from 0.28 --to 0.27 --step -0.002 --observable energy --store sweep.h5
  dynkit sweep sweep.toml --keep 50 --out sweep.npz

sweep.toml may hold:
  damping = 0.1
  parameter = "frequency"
  from = 0.86
  to = 0.88
  step = 0.01
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynkit.analysis.diagram import BifurcationDiagram
from dynkit.cli.options import OBSERVABLE, SYSTEM, Asked, Option, options_of, values_of
from dynkit.cli.output import OUT, counted, files_of, print_summary, write
from dynkit.core.reprs import costing, span
from dynkit.plotting.figures import new_figure
from dynkit.sweeps import sweep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit.sweeps import Sweep

_SIMULATION = ("transient", "keep", "follow", "store", "progress")
OPTIONS = (
    *SYSTEM,
    Option("parameter", "NAME", "parameter to sweep (frequency)"),
    Option("from", "X", "first value"),
    Option("to", "X", "last value"),
    Option("step", "X", "difference of successive values; may be negative"),
    Option("values", "X1,X2,...", "list of values, instead of --from, --to, --step"),
    *options_of(sweep, *_SIMULATION),
    OBSERVABLE,
    Option("labels", "", "label the motion at each value, such as P(1,3) (yes)"),
    Option("error", "", "estimate the error at each value by three more runs (no)"),
    OUT,
)


def run(asked: Asked) -> None:
    """Sweep, write files, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; no file has been written then.
    """
    values = values_of(asked)
    parameter = asked.parameter(asked.get("parameter", "frequency"))
    asked.refuse_changing([parameter], "when it is swept")
    chain = asked.chain(**{parameter: float(values[0])})
    names = asked.names("observable", chain.observables[:1], chain.observables)
    _, file = files_of(asked)
    options = {"start": asked.start(chain), "observables": names, **asked.only(*_SIMULATION)}
    found = sweep(chain, parameter, values, **options)
    labels = [label.name for label in found.labels] if asked.get("labels", True) else []
    error = {"error": found.error} if asked.get("error", False) else {}
    kept = {name: found.observable(name) for name in names}
    if file:
        write(file, partial(_diagram, found, bool(labels)), found.dataset())
    shown = {
        parameter: f"{span(values)}, {len(values)} values",
        **({"labels": counted(labels)} if labels else {}),
        **{name.replace("_", " "): span(array) for name, array in kept.items()},
        "cost": costing(found.cost),
        **{name: f"{x.max():.1e} at most, median {np.median(x):.1e}" for name, x in error.items()},
    }
    print_summary(shown, file)


def _diagram(found: Sweep, labelled: bool) -> Figure:
    """Return a figure with one diagram below the other for each observable, labels on top."""
    names = found.observables
    figure, panels = new_figure(height=2.4 * len(names) + 0.4, rows=len(names))
    for name, axes in zip(names, panels, strict=True):
        above = labelled and axes is panels[0]
        diagram = BifurcationDiagram.of(found, labelled=above)
        diagram.plot(axes, observable=name)
    return figure
