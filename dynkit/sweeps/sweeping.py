"""`sweep`: the motion at values of a parameter."""

import os
from collections.abc import Sequence
from concurrent.futures import Executor

from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import collect
from dynkit.sweeps.plan import Values, plan_of
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
    """Simulate the motion at values of a parameter, each from where the one before it ended.

    A state that lies on an orbit to rounding stays there where the orbit becomes unstable, however
    long it is simulated, and a symmetric motion stays symmetric. A sweep that follows therefore
    looks at the multipliers wherever the kept states recur, three periods of them at least. Where
    these do not prove that the orbit attracts, the last state is displaced, by the square root of
    the system's `accuracy` (1.5e-8 where that is rounding) relative to the motion: far above
    rounding, far below the motion. It is then simulated again, as often (up to 16 times) as a
    disturbance of that size needs to grow to the size of the motion. A motion that comes back, or
    stays, where nothing proves that it is unstable, remains as it was. `Sweep.displaced` says where
    states were displaced. Stable motions, however narrow their basins, are never displaced.

    Parameters
    ----------
    system : Map
        What is swept. Its own value of the parameter has no effect.
    parameter : str
        One of the system's ``parameters``.
    values : (k,) array_like
        In the order to follow, which may go up and down.
    transient : int
        How many states to skip at each value.
    keep : int
        How many states to keep at each value.
    observables : sequence of str, optional
        What to keep of a state, nothing else is stored: among the system's ``observables``, by
        default the first (``relative_velocity`` for impact oscillators). Those of a plain map are
        the coordinates of its states, ``state[0]`` and so on.
    start : state, optional
        Where the first value starts; by default where the system always does. A plain map needs
        one.
    follow : bool
        Whether each value starts from the last state of the value before it; otherwise all start
        like the first.
    executor : concurrent.futures.Executor, optional
        Who simulates, in chunks, values that do not follow one another: processes, threads, Dask,
        MPI. The result is the same bits by any executor with any number of workers, and by none.
    store : path, optional
        An HDF5 file that keeps what is finished. It is rewritten every second, or less often when
        that takes long, and when the sweep ends or is interrupted. The same call resumes it, by
        whatever executor, and gives (on the same machine) the same bits as one that was never
        interrupted.
    progress : bool
        Whether to show a bar on standard error, with the current parameter, and its label where
        the kept states tell.

    Returns
    -------
    Sweep

    Raises
    ------
    ValueError
        When an argument is refused, by name, before anything is simulated or written; among them a
        store of another sweep, of another version, damaged, or in use. When a system refuses a
        state or value only on the way: what was finished before is kept in the store.
    dynkit.WorkerLost
        When a worker died and its executor does not start another: what was finished before is kept
        in the store.
    OSError
        When the store cannot be written any more, on the way.

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
    plan = plan_of(
        system,
        parameter,
        values,
        transient=transient,
        keep=keep,
        observables=observables,
        start=start,
        follow=follow,
    )
    if plan.follow and executor is not None:
        raise ValueError(
            "executor must be None when each value starts where the last one ended "
            f"(follow=False starts all by themselves); got {executor!r}"
        )
    points = Values(plan)
    return Sweep._of(points, collect(points, executor=executor, store=store, progress=progress))
