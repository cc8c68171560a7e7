"""`dynkit continue`: a branch of periodic orbits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dynkit.cli.options import CHAIN, Options, chain_of, text_of
from dynkit.cli.output import PICTURES, output_file, writable_file, write_picture
from dynkit.cli.summary import print_summary
from dynkit.cli.sweep import SYMBOLS
from dynkit.core.validation import finite_scalar, in_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.continuation.branch import Branch
    from dynkit.orbits.problem import PeriodicOrbit
    from dynkit.systems.impact.chain import ImpactChain


def continue_branch(options: Options) -> None:
    """Continue a periodic orbit, write, and print its bifurcations.

    Raises
    ------
    ValueError
        When an option is refused; nothing was written then.
    """
    from dynkit.continuation.continuing import continue_orbit

    parameter = text_of(options, "parameter", "frequency") or "frequency"
    known = [option.name for option in CHAIN if option.name != "masses"]
    if parameter not in known:
        raise ValueError(f"parameter must be one of: {', '.join(known)}; got {parameter!r}")
    for name in ("from", "to"):
        if name not in options:
            raise ValueError(f"{name} must be given")
    low, high = (finite_scalar(name, options[name]) for name in ("from", "to"))
    if not low < high:
        raise ValueError(f"to must be greater than from; got {options['to']!r}")
    chain = chain_of(options)
    in_interval(parameter, getattr(chain, parameter), low, high)
    store, out = text_of(options, "store"), text_of(options, "out")
    if store is not None:
        writable_file("store", Path(store))
    file = None if out is None else output_file("out", out)
    if file is not None and file.suffix not in PICTURES:
        raise ValueError(f"out must end in {', '.join(PICTURES)}; got {out!r}")
    orbit = _start(chain, options)
    branch = continue_orbit(orbit, parameter, bounds=(low, high))
    if store is not None:
        branch.save(store)
    if file is not None:
        write_picture(file, lambda: _figure(branch))
    shown = _summary(orbit, branch)
    written = [str(path) for path in (store, file) if path is not None]
    if written:
        shown["written"] = ", ".join(written)
    print_summary(shown, None)
    if branch.bifurcations:
        print()
        _print_table(branch)


def _start(chain: ImpactChain, options: Options) -> PeriodicOrbit:
    if "impacts" in options or "periods" in options:
        if "transient" in options:
            raise ValueError(
                "transient must not be given beside impacts or periods; "
                f"got {options['transient']!r}"
            )
        return chain.periodic_orbit(
            impacts=options.get("impacts", 1), periods=options.get("periods", 1)
        )
    attractor = chain.attractor(transient=options.get("transient", 700))
    if attractor.label.periods is None:
        raise ValueError(
            f"impacts and periods must be given where the motion is not P(n,m) or P(inf,m); at "
            f"frequency {chain.frequency:g} it is {attractor.label}"
        )
    return attractor.periodic_orbit()


def _summary(orbit: PeriodicOrbit, branch: Branch) -> dict[str, str]:
    motions = branch.admissible
    low, high = branch.parameter.min(), branch.parameter.max()
    return {
        "started from": f"{orbit.label}, {'stable' if orbit.stable else 'unstable'}"
        + ("" if orbit.admissible else ", inadmissible"),
        branch.name: f"{low:.6g} to {high:.6g}, {len(branch)} points",
        "stable": f"{(branch.stable & motions).sum()} points",
        "unstable": f"{(~branch.stable & motions).sum()} points",
        "inadmissible": f"{(~motions).sum()} points",
        "ends": "; ".join(dict.fromkeys(map(str, branch.endings))),
        "cost": f"{branch.cost.counts['newton_steps']} Newton steps in {branch.cost.seconds:.2f} s",
    }


def _print_table(branch: Branch) -> None:
    rows = [["kind", branch.name, "multiplier", "admissible", "error", "Newton steps", "seconds"]]
    rows += [
        [
            found.kind,
            f"{found.value:.12g}",
            _multiplier(found),
            "yes" if found.admissible else "no",
            f"{found.error:.0e}",
            str(found.cost.counts["newton_steps"]),
            f"{found.cost.seconds:.3f}",
        ]
        for found in branch.bifurcations
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)]
        print("  ".join(cells).rstrip())


def _multiplier(found: Bifurcation) -> str:
    if found.multiplier is None:
        return "-"
    number = complex(found.multiplier)
    if abs(number.imag) < 1e-12:
        return f"{number.real:.6g}"
    return f"{number.real:.6g} +- {abs(number.imag):.6g}i"


def _figure(branch: Branch) -> Figure:
    from dynkit.continuation.network_drawing import draw_branches
    from dynkit.plotting.figures import new_figure, print_style

    figure, (axes,) = new_figure()
    with print_style():
        draw_branches([branch], axes, None)
        for text, axis in ((branch.name, axes.xaxis), ("relative_velocity", axes.yaxis)):
            axis.set_label_text(f"{text.replace('_', ' ')} ${SYMBOLS[text]}$")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure
