"""A map of two parameters: the motion at each pair of values.

All motions start from the same state.

Options may also be in a TOML file, under the same names; the command line
overrides the file. With --store every finished chunk is kept, and the same
command resumes, also with another number of --workers: the results are
identical.

For instance:
  dynkit map --x frequency,0.2,1.8,60 --y damping,0.02,0.3,40 --workers 2 --out map.png
  dynkit map --frequency 0.87 --x restitution,0.5,0.9,20 --y offset,-0.1,0.1,20 --out map.csv
  dynkit map map.toml --store map.h5 --out map.svg

map.toml may hold:
  x = ["frequency", 0.2, 1.8, 200]
  y = ["damping", 0.02, 0.3, 200]
  transient = 900
  workers = 8
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np

from dynkit.cli.options import OBSERVABLE, SYSTEM, Asked, Option, options_of
from dynkit.cli.output import OUT, counted, files_of, plotted, print_summary, write
from dynkit.core.reprs import costing, span
from dynkit.core.validation import finite_scalar, positive_integer
from dynkit.engine.collecting import MOST_POINTS
from dynkit.sweeps.planes import parameter_map

if TYPE_CHECKING:
    from dynkit.core.validation import Array

_SIMULATION = ("transient", "keep", "exponents", "store", "progress")
_AXIS = "PARAMETER,FROM,TO,COUNT"
OPTIONS = (
    *SYSTEM,
    Option("x", _AXIS, "parameter along x and its values"),
    Option("y", _AXIS, "parameter along y and its values"),
    *options_of(parameter_map, *_SIMULATION),
    OBSERVABLE,
    Option("workers", "COUNT", "processes that simulate (1)"),
    OUT,
)


def run(asked: Asked) -> None:
    """Compute a map of two parameters, write files, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; no file has been written then.
    """
    values = dict(_axis(asked, name) for name in ("x", "y"))
    if len(values) < 2:
        raise ValueError(f"y must be of another parameter than x; got {asked['y']!r}")
    asked.refuse_changing(values, "when it changes")
    chain = asked.chain(**{name: float(axis[0]) for name, axis in values.items()})
    names = asked.names("observable", chain.observables[:1], chain.observables)
    workers = positive_integer("workers", asked.get("workers", 1))
    _, file = files_of(asked)
    options = {"start": asked.start(chain), "observables": names, **asked.only(*_SIMULATION)}
    pool = ProcessPoolExecutor(workers, get_context("spawn")) if workers > 1 else nullcontext()
    with pool as executor:
        found = parameter_map(chain, values, executor=executor, **options)
    largest = {name: found.largest(name) for name in names}
    if file:
        write(file, partial(plotted, found, height=3.4), found.dataset())
    shown = {
        **{name: f"{span(axis)}, {len(axis)} values" for name, axis in values.items()},
        "labels": counted(found.names.ravel().tolist()),
        **{f"largest {name.replace('_', ' ')}": span(x) for name, x in largest.items()},
        "cost": f"{costing(found.cost)}, of all workers",
    }
    print_summary(shown, file)


def _axis(asked: Asked, name: str) -> tuple[str, Array]:
    """Return the parameter and the values (count,) of an axis; ValueError when refused."""
    given = asked.get(name)
    if not isinstance(given, list | tuple) or len(given) != 4 or not isinstance(given[0], str):
        raise ValueError(f"{name} must be NAME,FROM,TO,COUNT; got {given!r}")
    parameter = asked.parameter(given[0], name)
    first, last = (finite_scalar(name, value) for value in given[1:3])
    count = positive_integer(f"COUNT of {name}", given[3])
    if count > MOST_POINTS:
        raise ValueError(f"COUNT of {name} must not exceed {MOST_POINTS}; got {count}")
    return parameter, np.linspace(first, last, count)
