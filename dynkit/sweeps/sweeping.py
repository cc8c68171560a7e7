"""`sweep`: the motion at values of a parameter."""

import os
from collections.abc import Sequence
from concurrent.futures import Executor

from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import (
    Array,
    boolean,
    non_negative_integer,
    positive_integer,
    within_memory,
)
from dynkit.data.store import kind_of
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import collect
from dynkit.engine.points import MOST_POINTS
from dynkit.sweeps.plan import Plan, Values, known_names, packed_start, swept_values
from dynkit.sweeps.result import Sweep


def sweep(
    system: Map,
    parameter: str,
    values: Array | Sequence[float],
    *,
    transient: int = 700,
    keep: int = 100,
    observables: Sequence[str] | None = None,
    start: object = None,
    follow: bool = True,
    executor: Executor | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Sweep:
    """Simulate the motion at each value of a parameter, from the last state at the value before.

    In a simulation, a state on an unstable orbit may stay there, and a symmetric motion stays
    symmetric. Therefore a following sweep checks the multipliers wherever the kept states recur for
    at least three periods. (For one hard stop it first checks norms of derivatives.) If these do
    not prove that the orbit is stable, the last state is displaced. The displacement, relative to
    the motion, is the square root of the system's `accuracy` (1.5e-8 for rounding): far above
    rounding, and far below the motion. The motion is then simulated again, for as many runs (at
    most 16) as a disturbance of that size needs to grow to the size of the motion. Where
    instability is not proved and the displaced motion remains near the orbit, the motion before the
    displacement is kept. `Sweep.displaced` marks displaced motions. Stable motions, however narrow
    their basins, are never displaced.

    Parameters
    ----------
    system : Map
        The swept system; its value of the parameter has no effect.
    parameter : str
        One of the system's ``parameters``.
    values : (k,) array_like
        Values of the parameter in the order of the sweep, ascending or not.
    transient : int
        Number of states to skip at each value.
    keep : int
        Number of states to keep at each value.
    observables : sequence of str, optional
        Observables to keep, among the system's ``observables``; by default the first
        (``relative_velocity`` for impact oscillators). Those of a plain map are the coordinates of
        its states, ``state[0]`` and so on. Nothing else is stored.
    start : state, optional
        Start of the first value; by default that of the system. A plain map needs one.
    follow : bool
        Whether each value starts from the last state of the value before it; otherwise all values
        have the same start.
    executor : concurrent.futures.Executor, optional
        Executor that simulates chunks of values, with ``follow=False`` only: processes, threads,
        Dask, MPI. The result is the same bits with any executor and any number of workers, and
        without one.
    store : path, optional
        An HDF5 file that keeps finished values. It is rewritten every second, less often when
        writing takes long, and when the sweep ends or is interrupted. The same call resumes it,
        with any executor, and gives (on the same machine) the same bits as without interruption.
    progress : bool
        Whether to show a bar on standard error, with the current value, and its label where the
        kept states determine it.

    Returns
    -------
    Sweep

    Raises
    ------
    ValueError
        When an argument is refused, before any simulation or writing. A store is refused if it is
        of another sweep or another version, damaged, or in use. When a system refuses a state or a
        value during the run; the store keeps finished values.
    dynkit.WorkerLost
        When a worker died and its executor does not replace it; the store keeps finished values.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> chain = ImpactChain(masses=10, frequency=0.87)
    >>> found = sweep(chain, "frequency", [0.86, 0.87, 0.88], progress=False)
    >>> found.observable("relative_velocity").shape
    (3, 100)
    >>> print(*found.labels)
    P(1,3) P(1,3) P(1,3)
    """
    checked_map(system, Map)
    system.value_of(parameter)
    array = swept_values("values", values)
    if len(array) > MOST_POINTS:
        raise ValueError(f"values must not be more than {MOST_POINTS}; got {len(array)}")
    skipped = non_negative_integer("transient", transient)
    kept = positive_integer("keep", keep)
    names = known_names(system.observables, observables)
    within_memory("keep", kept, 8.0 * kept * len(array) * len(names))
    for place, value in enumerate(array.tolist()):
        try:
            system.replace(**{parameter: value})
        except ValueError as refusal:
            raise ValueError(f"{refusal} in values[{place}]") from refusal
    packed = packed_start(system.replace(**{parameter: float(array[0])}), start)
    following = boolean("follow", follow)
    if following and executor is not None:
        raise ValueError(
            "executor must be None when each value starts from the last state of the one before "
            f"it (follow=False makes them independent); got {executor!r}"
        )
    kind = kind_of(system)
    plan = Plan(system, kind, parameter, array, skipped, kept, names, packed, following)
    points = Values(plan)
    return Sweep._of(points, collect(points, executor=executor, store=store, progress=progress))
