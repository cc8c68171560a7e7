"""`basins`: the attractor of each start."""

from __future__ import annotations

import os
from concurrent.futures import Executor
from functools import partial

from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import (
    finite_array,
    non_negative_integer,
    positive_integer,
    regular_array,
    within_memory,
)
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import MOST_POINTS, collect
from dynkit.engine.executors import all_finished
from dynkit.sweeps.basins.arriving import Starts
from dynkit.sweeps.basins.classification import look_at
from dynkit.sweeps.basins.matching import group_starts
from dynkit.sweeps.basins.result import Basins


def basins(
    system: Map,
    starts: object,
    *,
    transient: int = 700,
    keep: int = 100,
    executor: Executor | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Basins:
    """Find the attractor of each start, and the basins of the attractors.

    Periodic motions are simulated until they recur to 1e-10, relative to the largest number of the
    starts and of the states. Two of them have the same attractor when a state of one lies on the
    orbit of the other, within 1e-8 plus the estimated distances of both from their orbits. So
    different orbits with the same label are separate attractors, and all motions on one orbit have
    the same attractor. A motion further than 1e-4 from its orbit is unsettled.

    Chaotic motions are compared by their states. Two of them have the same attractor when at least
    half of 64 states of one, or of 1024 further ones, are on the attractor of the other. A state is
    on an attractor if it is not farther from the nearest of the attractor's 2000 states than the
    third neighbour of that state is. Attractors
    that are closer than this are not separated. Where chaos ends within these 2000 states, the
    later motion decides. Quasi-periodic motions are compared in the same way, after as many states
    as their labels examined. The 2000 states are then a sample of as many, for near a resonance a
    motion fills its curve slowly.

    Motions without impacts are separated by the reasons of their endings.

    If there are 1000 or more starts of an impact oscillator, a random sample of them is simulated
    first, with as many starts as the square root of their number. Any other motion ends when it is
    within 1e-8 of a stable periodic orbit of the sample, now and a period later. The distance is
    relative to the size of the orbit.
    The first start of each basin is simulated to the end, and so is every motion that does not
    arrive in this way.

    A start on an unstable orbit stays there and is a basin of its own, whose label says
    ``unstable``. Motions near an unstable orbit are simulated for 20,000 more states, in which
    they leave it.

    Parameters
    ----------
    system : Map
        An impact oscillator, or a map such as a Poincare map.
    starts : (k1, k2, s) or (k, s) array_like
        Numbers of the starts: for a map its coordinates, s = d; for an impact oscillator its N
        positions, N velocities and the phase of the table, s = 2N + 1.
    transient, keep : int
        Number of states to skip and to keep, before a motion is labelled.
    executor : concurrent.futures.Executor, optional
        Executor that simulates chunks: processes, threads, Dask, MPI. The result is the same bits
        with any executor and any number of workers, and without one.
    store : path, optional
        An HDF5 file that keeps finished starts, as for `dynkit.sweep`: the same call resumes it,
        with any executor.
    progress : bool
        Whether to show a bar on standard error; on a terminal also while chaotic motions are
        compared.

    Returns
    -------
    Basins

    Raises
    ------
    ValueError
        When an argument is refused, before any simulation or writing. A store is refused if it is
        of other starts or another version, damaged, or in use. When no start is a state.
    dynkit.WorkerLost
        When a worker died and its executor does not replace it; the store keeps finished starts.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    Two stable motions of the chain at one frequency, both P(2,3):

    >>> import numpy as np
    >>> from dynkit.systems import ImpactChain
    >>> chain = ImpactChain(frequency=0.8)
    >>> state = chain.state()
    >>> starts = np.tile([*state.position, *state.velocity, 0.0], (6, 1))
    >>> starts[:, -1] = np.arange(6)  # the phase of the table
    >>> found = basins(chain, starts, progress=False)
    >>> [str(basin.label) for basin in found.basins]
    ['P(2,3)', 'P(2,3)']
    """
    size = checked_map(system, Map).start_size
    given = regular_array("starts", starts)
    if given.ndim not in (2, 3) or not given.size:
        raise ValueError(
            f"starts must have shape (k, {size}) or (k1, k2, {size}), and hold one or "
            f"more; got shape {given.shape}"
        )
    if given.size // size > MOST_POINTS:
        raise ValueError(f"starts must not be more than {MOST_POINTS}; got {given.size // size}")
    rows = finite_array("starts", starts, (*given.shape[:-1], size)).reshape(-1, size).copy()
    rows.setflags(write=False)
    kept = positive_integer("keep", keep)
    look = look_at(
        system,
        rows,
        non_negative_integer("transient", transient),
        within_memory("keep", kept, 8.0 * kept * system.dimension),
    )
    points = Starts(look, rows, executor)
    found = collect(points, executor=executor, store=store, progress=progress)
    finish = partial(all_finished, executor=executor, bar="comparison" if progress else "")
    numbers, basins = group_starts(look, found, rows, given.shape[:-1], finish)
    cost = points.sampling + found.cost
    return Basins(rows.reshape(given.shape), numbers, basins, cost, look)
