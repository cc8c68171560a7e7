"""`parameter_map`: the kinds of motion at all pairs of values of two parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import collect
from dynkit.sweeps.planes.plan import Grid, plan_of
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
        Its own values of the two parameters have no effect.
    values : mapping of str to array_like
        The values of two of the system's ``parameters``, (k1,) and (k2,), in any order.
    transient : int
        How many states to skip at each pair.
    keep : int
        How many states to keep at each pair.
    observables : sequence of str, optional
        Of which the largest value is kept: among the system's ``observables``, by default the
        first (``relative_velocity`` for impact oscillators).
    exponents : int
        Over how many states more to average the largest Lyapunov exponent; 0 for not at all.
    start : state, optional
        Where all pairs start; by default where the system always does. A plain map needs one.
    executor : concurrent.futures.Executor, optional
        Who simulates, in chunks: processes, threads, Dask, MPI. The result is the same bits by any
        executor with any number of workers, and by none.
    store : path, optional
        An HDF5 file that keeps what is finished. As for `dynkit.sweep` the same call resumes it, by
        whatever executor.
    progress : bool
        Whether to show a bar on standard error.

    Returns
    -------
    ParameterMap
        A pair without a motion, such as one that runs away, is labelled ``no motion``; one that
        the system refuses, or at which it refuses the start, ``refused``. `ParameterMap.endings`
        holds the message.

    Raises
    ------
    ValueError
        When an argument is refused, by name, before anything is simulated or written; among them a
        store of another map, of another version, damaged, or in use.
    dynkit.WorkerLost
        When a worker died and its executor does not start another: what was finished before is kept
        in the store.
    OSError
        When the store cannot be written any more, on the way.

    Examples
    --------
    >>> from dynkit.systems import Henon
    >>> values = {"a": [0.2, 1.0, 1.2], "b": [0.0, 0.3]}
    >>> found = parameter_map(Henon(), values, start=[0.1, 0.1], progress=False)
    >>> found.names.tolist()
    [['P(1)', 'P(1)'], ['P(2)', 'P(4)'], ['P(2)', 'chaotic']]
    """
    plan, axes = plan_of(
        system,
        values,
        transient=transient,
        keep=keep,
        observables=observables,
        exponents=exponents,
        start=start,
    )
    grid = Grid(plan, axes)
    return ParameterMap._of(grid, collect(grid, executor=executor, store=store, progress=progress))
