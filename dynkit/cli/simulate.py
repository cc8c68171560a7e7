"""`dynkit simulate`: one motion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dynkit.cli.options import CHAIN, Options, chain_of, names_of, text_of
from dynkit.cli.output import PICTURES, output_file, write_arrays, write_picture, write_table
from dynkit.cli.summary import print_summary, sizes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit.core.validation import Array
    from dynkit.systems.impact.attractor import ImpactAttractor
    from dynkit.systems.impact.record import ImpactRecord

_SCALARS = ("time", "phase", "relative_velocity", "energy")
_OBSERVABLES = (*_SCALARS, "position", "velocity")


def simulate(options: Options) -> None:
    """Simulate, write, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; nothing was written then.
    """
    names = names_of(options, "observable", _SCALARS)
    for name in names:
        if name not in _OBSERVABLES:
            raise ValueError(f"observable must be one of: {', '.join(_OBSERVABLES)}; got {name!r}")
    out = text_of(options, "out")
    file = None if out is None else output_file("out", out)
    chain = chain_of(options)
    start = chain.state(options.get("position"), options.get("velocity"), options.get("phase", 0.0))
    attractor = chain.attractor(
        transient=options.get("transient", 700), impacts=options.get("impacts", 100), start=start
    )
    if file is not None:
        _write(file, attractor, names)
    record = attractor.record
    shown = {
        "label": f"{attractor.label} (from {attractor.label.simulated} impacts)",
        "impacts": f"{len(record)} after {attractor.transient} that were skipped",
        "ending": record.ending.value,
        "contacts": f"{len(record.sticking)} intervals of sticking",
        "relative velocity": sizes(record.relative_velocity),
        "energy": sizes(record.energy),
        "error": f"{attractor.error:.1e} (estimate of the largest in a state kept)",
        "seconds": f"{attractor.cost.seconds:.3f}",
    }
    print_summary(shown, file)


def _write(file: Path, attractor: ImpactAttractor, names: tuple[str, ...]) -> None:
    record = attractor.record
    if file.suffix in PICTURES:
        write_picture(file, lambda: _section(record))
        return
    arrays: dict[str, Array] = {name: getattr(record, name) for name in names}
    if file.suffix == ".csv":
        columns: dict[str, list[float]] = {}
        for name, array in arrays.items():
            if array.ndim == 1:
                columns[name] = array.tolist()
            else:
                for i, column in enumerate(array.T, 1):
                    columns[f"{name}_{i}"] = column.tolist()
        write_table(file, columns)
        return
    parameters = {option.name: getattr(record.system, option.name) for option in CHAIN}
    write_arrays(file, {**arrays, "sticking": record.sticking}, parameters)


def _section(record: ImpactRecord) -> Figure:
    """Relative velocity against phase: the impact section."""
    import math

    from dynkit.plotting.figures import DOTS, ink, new_figure

    figure, (axes,) = new_figure()
    axes.plot(
        record.phase, record.relative_velocity, markersize=1.0, rasterized=True, color=ink(), **DOTS
    )
    axes.set_xlabel(r"phase of the table $\phi$")
    axes.set_ylabel("relative velocity after impact $u$")
    axes.set_xlim(0.0, 2.0 * math.pi)
    axes.set_xticks([0.0, math.pi, 2.0 * math.pi], ["0", r"$\pi$", r"$2\pi$"])
    axes.set_ylim(bottom=0.0)
    return figure
