"""`dynkit map`: a map of two parameters."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.cli.options import CHAIN, Options, chain_of, switch_of, text_of
from dynkit.cli.output import (
    PICTURES,
    output_file,
    writable_file,
    write_arrays,
    write_picture,
    write_table,
)
from dynkit.cli.summary import print_summary, sizes
from dynkit.cli.sweep import SYMBOLS
from dynkit.core.validation import finite_scalar, positive_integer
from dynkit.engine.points import MOST_POINTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynkit.core.validation import Array
    from dynkit.sweeps.planes import ParameterMap

_MOST_LABELS = 12


def parameter_map(options: Options) -> None:
    """Make a map of two parameters, write, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; nothing was written then.
    """
    from dynkit.sweeps.planes import parameter_map as mapped

    values = dict(_axis(options, name) for name in ("x", "y"))
    if len(values) < 2:
        raise ValueError(f"y must be of another parameter than x; got {options['y']!r}")
    for name in values:
        if name in options:
            raise ValueError(f"{name} must not be given when it changes; got {options[name]!r}")
    chain = chain_of({**options, **{name: float(axis[0]) for name, axis in values.items()}})
    progress = switch_of(options, "progress", default=True)
    workers = positive_integer("workers", options.get("workers", 1))
    store, out = text_of(options, "store"), text_of(options, "out")
    if store is not None:
        writable_file("store", Path(store))
    file = None if out is None else output_file("out", out)
    if file is not None and store is not None and file.resolve() == Path(store).resolve():
        raise ValueError(f"out must be another file than store; got {out!r}")
    with _executor(workers) as executor:
        found = mapped(
            chain,
            values,
            transient=options.get("transient", 700),
            keep=options.get("keep", 100),
            executor=executor,
            store=store,
            progress=progress,
        )
    if file is not None:
        _write(file, found)
    print_summary(_summary(found), file)


def _executor(workers: int) -> AbstractContextManager[Executor | None]:
    if workers == 1:
        return nullcontext()
    return ProcessPoolExecutor(workers, get_context("spawn"))


def _axis(options: Options, name: str) -> tuple[str, Array]:
    """Return parameter and values (count,) of an axis.

    Raises
    ------
    ValueError
        When they are missing, or refused.
    """
    import numpy as np

    given = options.get(name)
    if not isinstance(given, list | tuple) or len(given) != 4 or not isinstance(given[0], str):
        raise ValueError(f"{name} must be NAME,FROM,TO,COUNT; got {given!r}")
    known = [option.name for option in CHAIN if option.name != "masses"]
    if given[0] not in known:
        raise ValueError(f"{name} must name one of: {', '.join(known)}; got {given[0]!r}")
    first, last = (finite_scalar(name, value) for value in given[1:3])
    count = positive_integer(f"COUNT of {name}", given[3])
    if count > MOST_POINTS:
        raise ValueError(f"COUNT of {name} must not exceed {MOST_POINTS}; got {count}")
    return given[0], np.linspace(first, last, count)


def _summary(found: ParameterMap) -> dict[str, str]:
    shown = {
        name: f"{axis[0]:.6g} to {axis[-1]:.6g}, {len(axis)} values"
        for name, axis in found.values.items()
    }
    counts = Counter(found.names.ravel().tolist()).most_common()
    words = [f"{label} {count}" for label, count in counts[:_MOST_LABELS]]
    if len(counts) > _MOST_LABELS:
        words.append(f"{len(counts) - _MOST_LABELS} more")
    shown["labels"] = ", ".join(words)
    for name in found.observables:
        shown[f"largest {name.replace('_', ' ')}"] = sizes(found.largest(name))
    impacts = found.cost.counts.get("impacts", 0)
    shown["cost"] = f"{impacts} impacts in {found.cost.seconds:.2f} s of all workers"
    return shown


def _write(file: Path, found: ParameterMap) -> None:
    if file.suffix in PICTURES:
        write_picture(file, lambda: _picture(found))
        return
    import numpy as np

    cells: dict[str, Any] = {
        "label": found.names,
        "impacts": found.impacts,
        "periods": found.periods,
        **{f"largest_{name}": found.largest(name) for name in found.observables},
        "error": found.error,
    }
    if file.suffix == ".csv":
        axes = np.meshgrid(*found.values.values(), indexing="ij")
        columns = {**dict(zip(found.parameters, axes, strict=True)), **cells}
        write_table(file, {name: array.ravel().tolist() for name, array in columns.items()})
    else:
        write_arrays(file, {**found.values, **cells}, {"parameters": list(found.parameters)})


def _picture(found: ParameterMap) -> Figure:
    from dynkit.plotting.figures import new_figure, print_style

    figure, (axes,) = new_figure(height=3.4)
    with print_style():
        found.plot(axes)
        for name, axis in zip(found.parameters, (axes.xaxis, axes.yaxis), strict=True):
            axis.set_label_text(f"{name} ${SYMBOLS[name]}$")
    return figure
