"""`parameter_map`: the kinds of motion at all pairs of values of two parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import Array, non_negative_integer, positive_integer, within_memory
from dynkit.data.store import kind_of
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import collect
from dynkit.sweeps.plan import known_names, packed_start
from dynkit.sweeps.planes.plan import Plan, axes_of
from dynkit.sweeps.planes.result import ParameterMap


def parameter_map(
    system: Map,
    values: Mapping[str, Array | Sequence[float]],
    *,
    transient: int = 700,
    keep: int = 100,
    observables: Sequence[str] | None = None,
    exponents: int = 0,
    start: object = None,
    executor: Executor | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> ParameterMap:
    """Label the motion at all pairs of values of two parameters, each from the same start.

    Parameters
    ----------
    system : Map
        The swept system; its values of the two parameters have no effect.
    values : mapping of str to array_like
        The values of two of the system's ``parameters``, (k1,) and (k2,), in any order.
    transient : int
        Number of states to skip at each pair.
    keep : int
        Number of states to keep at each pair.
    observables : sequence of str, optional
        Observables whose largest values are kept, among the system's ``observables``; by default
        the first (``relative_velocity`` for impact oscillators).
    exponents : int
        Number of further states for the largest Lyapunov exponent; 0 for no exponents.
    start : state, optional
        Start at all pairs; by default that of the system. A plain map needs one.
    executor : concurrent.futures.Executor, optional
        Executor that simulates chunks: processes, threads, Dask, MPI. The result is the same bits
        with any executor and any number of workers, and without one.
    store : path, optional
        An HDF5 file that keeps finished pairs. As for `dynkit.sweep` the same call resumes it, with
        any executor.
    progress : bool
        Whether to show a bar on standard error.

    Returns
    -------
    ParameterMap
        A pair without a motion, such as a diverging one, is labelled ``no motion``; a pair that the
        system refuses, or at which it refuses the start, ``refused``. `ParameterMap.endings` holds
        the message.

    Raises
    ------
    ValueError
        When an argument is refused, before any simulation or writing. A store is refused if it is
        of another map or another version, damaged, or in use.
    dynkit.WorkerLost
        When a worker died and its executor does not replace it; the store keeps finished pairs.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    >>> from dynkit.systems import Henon
    >>> values = {"a": [0.2, 1.0, 1.2], "b": [0.0, 0.3]}
    >>> found = parameter_map(Henon(), values, start=[0.1, 0.1], progress=False)
    >>> found.names.tolist()
    [['P(1)', 'P(1)'], ['P(2)', 'P(4)'], ['P(2)', 'chaotic']]
    """
    axes = axes_of(checked_map(system, Map), values)
    first, second = axes
    packed = packed_start(system.replace(**{name: float(a[0]) for name, a in axes.items()}), start)
    kept = positive_integer("keep", keep)
    plan = Plan(
        system,
        kind_of(system),
        (first, second),
        non_negative_integer("transient", transient),
        within_memory("keep", kept, 8.0 * kept),
        known_names(system.observables, observables),
        non_negative_integer("exponents", exponents),
        packed,
        (axes[first], axes[second]),
    )
    return ParameterMap._of(plan, collect(plan, executor=executor, store=store, progress=progress))
