"""`dynkit sweep`: a sweep of one parameter."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.cli.options import (
    CHAIN,
    Options,
    chain_of,
    names_of,
    switch_of,
    text_of,
    values_of,
)
from dynkit.cli.output import (
    PICTURES,
    output_file,
    writable_file,
    write_arrays,
    write_picture,
    write_table,
)
from dynkit.cli.summary import print_summary, sizes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit.sweeps import Sweep
    from dynkit.systems.impact.chain import ImpactChain

SYMBOLS = {
    "frequency": r"\omega",
    "restitution": "r",
    "amplitude": "A",
    "offset": "A_0",
    "damping": r"\gamma",
    "springs": "k",
    "relative_velocity": "u",
    "energy": "E",
    "phase": r"\phi",
    "time": "t",
}
"""How parameters and observables are written on axes."""

_MOST_LABELS = 12


def sweep(options: Options) -> None:
    """Sweep, write, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; nothing was written then.
    """
    from dynkit.sweeps import sweep as follow

    names = names_of(options, "observable", ("relative_velocity",))
    parameter = text_of(options, "parameter", "frequency") or "frequency"
    labelled = switch_of(options, "labels", default=True)
    with_error = switch_of(options, "error", default=False)
    progress = switch_of(options, "progress", default=True)
    values = values_of(options)
    known = [option.name for option in CHAIN if option.name != "masses"]
    if parameter not in known:
        raise ValueError(f"parameter must be one of: {', '.join(known)}; got {parameter!r}")
    if parameter in options:
        raise ValueError(
            f"{parameter} must not be given when it is swept; got {options[parameter]!r}"
        )
    chain = chain_of({**options, parameter: float(values[0])})
    store, out = text_of(options, "store"), text_of(options, "out")
    if store is not None:
        writable_file("store", Path(store))
    file = None if out is None else output_file("out", out)
    if file is not None and store is not None and file.resolve() == Path(store).resolve():
        raise ValueError(f"out must be another file than store; got {out!r}")
    found = follow(
        chain,
        parameter,
        values,
        transient=options.get("transient", 700),
        keep=options.get("keep", 100),
        observables=names,
        store=store,
        progress=progress,
    )
    labels = [str(label) for label in found.labels] if labelled else []
    per_value: dict[str, list[float]] = {"error": found.error.tolist()} if with_error else {}
    if file is not None:
        _write(file, found, labels, per_value, chain)
    print_summary({**_summary(found, labels), **_spans(per_value)}, file)


def _spans(per_value: dict[str, list[float]]) -> dict[str, str]:
    return {
        name: f"{min(numbers):.1e} to {max(numbers):.1e}, half of the values below "
        f"{sorted(numbers)[len(numbers) // 2]:.1e}"
        for name, numbers in per_value.items()
    }


def _summary(found: Sweep, labels: list[str]) -> dict[str, str]:
    low, high = found.values[0], found.values[-1]
    shown = {found.parameter: f"{low:.6g} to {high:.6g}, {len(found)} values"}
    if labels:
        counts = Counter(labels).most_common()
        words = [f"{label} {count}" for label, count in counts[:_MOST_LABELS]]
        if len(counts) > _MOST_LABELS:
            words.append(f"{len(counts) - _MOST_LABELS} more")
        shown["labels"] = ", ".join(words)
    for name in found.observables:
        shown[name.replace("_", " ")] = sizes(found.observable(name))
    impacts = found.cost.counts.get("impacts", 0)
    shown["cost"] = f"{impacts} impacts in {found.cost.seconds:.2f} s"
    return shown


def _write(
    file: Path,
    found: Sweep,
    labels: list[str],
    per_value: dict[str, list[float]],
    chain: ImpactChain,
) -> None:
    if file.suffix in PICTURES:
        write_picture(file, lambda: _diagram(found, labels))
    elif file.suffix == ".csv":
        of_values: dict[str, list[Any]] = {**per_value, **({"label": labels} if labels else {})}
        write_table(file, _columns(found, of_values))
    else:
        arrays: dict[str, Any] = {
            "values": found.values,
            **{name: found.observable(name) for name in found.observables},
            **per_value,
        }
        if labels:
            arrays["labels"] = labels
        parameters = {option.name: getattr(chain, option.name) for option in CHAIN}
        del parameters[found.parameter]
        write_arrays(file, arrays, {"parameter": found.parameter, **parameters})


def _columns(found: Sweep, of_values: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """One row for each impact that was kept; what belongs to a value is repeated."""
    counts = found.counts.tolist()

    def repeated(numbers: list[Any]) -> list[Any]:
        return [number for number, count in zip(numbers, counts, strict=True) for _ in range(count)]

    columns = {
        found.parameter: repeated(found.values.tolist()),
        "impact": [i for count in counts for i in range(1, count + 1)],
    }
    for name in found.observables:
        rows = zip(found.observable(name), counts, strict=True)
        columns[name] = [number for row, count in rows for number in row[:count].tolist()]
    return columns | {name: repeated(numbers) for name, numbers in of_values.items()}


def _diagram(found: Sweep, labels: list[str]) -> Figure:
    """One diagram under the other, for all observables; the labels stand above the first."""
    from dynkit.analysis.diagram import BifurcationDiagram
    from dynkit.plotting.figures import new_figure

    observables = {name: found.observable(name) for name in found.observables}
    figure, panels = new_figure(height=2.4 * len(observables) + 0.4, rows=len(observables))
    for i, (name, axes) in enumerate(zip(observables, panels, strict=True)):
        BifurcationDiagram(
            found.parameter,
            found.values,
            {name: observables[name]},
            labels=labels if i == 0 else (),
            symbols=SYMBOLS,
        ).plot(axes)
    return figure
