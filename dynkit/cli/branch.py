"""The branch of a periodic orbit as one parameter changes, stable or unstable.

Its bifurcations are folds (SN), period doublings (PD), tori (NS), branch
points (BP), grazing (GR) and borders of chatter (CB). The branch passes
through folds and continues as inadmissible where its orbits are not motions
of the chain.

Options may also be in a TOML file, under the same names; the command line
overrides the file. The branch starts at the chain's value of the parameter,
and stays between --from and --to. A .csv file has a row for each point, and
a row for each bifurcation between them, with its kind; .h5 is the format of
--store.

For instance:
  dynkit continue --frequency 0.87 --from 0.7 --to 1.1
  dynkit continue --frequency 0.8 --impacts 2 --periods 3 --from 0.75 --to 0.83 --out branch.png
  dynkit continue --frequency 0.87 --parameter amplitude --from 0.05 --to 0.2 --store branch.h5
  dynkit continue --frequency 0.87 --from 0.7 --to 1.1 --out branch.csv
  dynkit continue branch.toml --out branch.svg

branch.toml may hold:
  damping = 0.1
  frequency = 0.87
  periods = 3
  parameter = "restitution"
  from = 0.5
  to = 0.95
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.cli.options import SYSTEM, Asked, Option, options_of
from dynkit.cli.output import OUT, aligned, files_of, plotted, print_summary, write
from dynkit.continuation.continuing import continue_orbit
from dynkit.core.reprs import costing, span, written
from dynkit.core.validation import finite_scalar, in_interval
from dynkit.data.dataset import Dataset
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

if TYPE_CHECKING:
    from dynkit.continuation.results.branch import Branch
    from dynkit.orbits.problem import PeriodicOrbit
    from dynkit.systems.impact.oscillators.chain import ImpactChain

_STEPS = ("step", "largest_step", "points", "inadmissible")
OPTIONS = (
    *SYSTEM,
    Option("impacts", "COUNT", "n, to start from an orbit P(n,m) instead of the attractor (1)"),
    Option("periods", "COUNT", "m, periods of the table in that orbit (1)"),
    *options_of(ImpactOscillator.attractor, "transient"),
    Option("parameter", "NAME", "parameter that changes along the branch (frequency)"),
    Option("from", "X", "least value of the parameter"),
    Option("to", "X", "greatest value of the parameter"),
    *options_of(continue_orbit, *_STEPS),
    Option("store", "FILE.h5", "file for the branch; dynkit.Branch.load reads it"),
    OUT,
)


def run(asked: Asked) -> None:
    """Continue a periodic orbit, write files, and print its bifurcations.

    Raises
    ------
    ValueError
        When an option is refused; no file has been written then.
    """
    parameter = asked.parameter(asked.get("parameter", "frequency"))
    for name in ("from", "to"):
        if name not in asked:
            raise ValueError(f"{name} must be given")
    low, high = (finite_scalar(name, asked[name]) for name in ("from", "to"))
    if not low < high:
        raise ValueError(f"to must be greater than from; got {asked['to']!r}")
    chain = asked.chain()
    in_interval(parameter, chain.value_of(parameter), low, high)
    store, file = files_of(asked)
    orbit = _orbit(asked, chain)
    branch = continue_orbit(orbit, parameter, bounds=(low, high), **asked.only(*_STEPS))
    for path in (store, file):
        if path and (path is store or path.suffix == ".h5"):
            branch.save(path)
        elif path:
            data = _in_order(branch) if path.suffix == ".csv" else branch.dataset()
            write(path, partial(plotted, branch), data)
    motions, count = branch.admissible, len(branch)
    shown = {
        "started from": f"{orbit.label}, {'stable' if orbit.stable else 'unstable'}"
        + ("" if orbit.admissible else ", inadmissible"),
        parameter: f"{span(branch.parameter)}, {count} points",
        "stable": f"{(branch.stable & motions).sum()} points",
        "unstable": f"{(~branch.stable & motions).sum()} points",
        "inadmissible": f"{(~motions).sum()} points",
        "ends": "; ".join(dict.fromkeys(map(str, branch.endings))),
        "cost": costing(branch.cost),
    }
    print_summary(shown, store, file)
    if branch.bifurcations:
        print("", *aligned(_table(branch)), sep="\n")


def _orbit(asked: Asked, chain: ImpactChain) -> PeriodicOrbit:
    given = asked.only("impacts", "periods")
    if given:
        asked.refuse(["transient"], "together with impacts or periods")
        orbit: PeriodicOrbit = chain.periodic_orbit(**given)
        return orbit
    attractor = chain.attractor(start=asked.start(chain), **asked.only("transient"))
    if attractor.label.periods is None:
        raise ValueError(
            f"impacts and periods must be given where the motion is not P(n,m) or P(inf,m); at "
            f"frequency {chain.frequency:g} it is {attractor.label}"
        )
    return attractor.periodic_orbit()


def _table(branch: Branch) -> list[list[str]]:
    heads = ["kind", branch.name, "multiplier", "admissible", "error", "Newton steps", "seconds"]
    return [heads] + [
        [
            found.kind,
            f"{found.value:.12g}",
            "-" if found.multiplier is None else written(complex(found.multiplier)),
            "yes" if found.admissible else "no",
            f"{found.error:.0e}",
            str(found.cost.counts["newton_steps"]),
            f"{found.cost.seconds:.3f}",
        ]
        for found in branch.bifurcations
    ]


def _in_order(branch: Branch) -> Dataset:
    """Return points and bifurcations in the order of the curve.

    The kind of a point is empty. Columns of points are NaN for bifurcations, and columns of
    bifurcations are NaN for points: their errors have different meanings.
    """
    found, size, name = branch.bifurcations, len(branch), branch.system.observables[0]
    critical = [np.nan if each.multiplier is None else each.multiplier for each in found]
    points, none = np.full(size, np.nan), np.full(len(found), np.nan)
    columns: dict[str, tuple[Any, Any]] = {
        branch.name: (branch.parameter, [each.value for each in found]),
        "kind": ([""] * size, [each.kind for each in found]),
        name: (branch.observable(name), [each.orbit.observable(name) for each in found]),
        "admissible": (branch.admissible, [each.admissible for each in found]),
        "largest_multiplier": (abs(branch.multipliers).max(axis=1), none),
        "distance_from_curve": (branch.error, none),
        "critical_multiplier_real": (points, np.real(critical)),
        "critical_multiplier_imaginary": (points, np.imag(critical)),
        f"error_of_{branch.name}": (points, [each.error for each in found]),
    }
    order = np.argsort([*range(size), *(each.place for each in found)], kind="stable")
    rows = {key: np.array([*first, *second])[order] for key, (first, second) in columns.items()}
    return Dataset({}, {key: (("row", "state")[: x.ndim], x) for key, x in rows.items()}, {})
