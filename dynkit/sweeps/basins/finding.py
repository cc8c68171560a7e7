"""`basins`: the attractor of each start, and its result."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, largest, system_repr, table
from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import (
    Array,
    finite_array,
    index_in,
    non_negative_integer,
    positive_integer,
    regular_array,
    within_memory,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved, read_result, write_result
from dynkit.data.store import identity_of, kind_of, refuse_other_system, understood
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import MOST_POINTS, collect
from dynkit.engine.executors import all_finished
from dynkit.sweeps.basins.arriving import Starts
from dynkit.sweeps.basins.classification import OTHER_ENDS, Look, look_at
from dynkit.sweeps.basins.matching import Basin, group_starts
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    every = Starts(look, rows, executor)
    found = collect(every.points, executor=executor, store=store, progress=progress)
    finish = partial(all_finished, executor=executor, bar="comparison" if progress else "")
    numbers, groups = group_starts(look, found, rows, given.shape[:-1], finish)
    cost = every.sampling + found.cost
    return Basins(rows.reshape(given.shape), numbers, groups, cost, look)


@final
@dataclass(frozen=True, eq=False, repr=False)
class Basins(Viewed, Saved):
    """The attractor of each start, and the basins of attraction; made by `dynkit.basins`.

    Parameters
    ----------
    starts : (k1, k2, s) or (k, s) array
        The starts, read-only.
    numbers : (k1, k2) or (k,) array of int
        The number of each start's attractor, read-only. Attractors are numbered in the order of the
        first starts that lead to them. A negative number means no attractor. The numbers are -1
        unsettled, -2 runs away, -3 comes to no next crossing, -4 no state of the system, -5 cannot
        be followed. A position beyond the table is no state.
    basins : tuple of Basin
        The attractors, by their numbers.
    cost : Cost
        Seconds of all workers, and counted work without that of labels.

    Examples
    --------
    >>> from dynkit import basins
    >>> from dynkit.systems import Logistic
    >>> found = basins(Logistic(rate=3.2), [[-0.1], [0.3], [0.5], [0.7]], progress=False)
    >>> found
    <Basins: 4 starts; P(2) 3, runs away 1>
    >>> found.numbers.tolist(), found.basins[0].fraction
    ([-2, 0, 0, 0], 0.75)
    >>> found.outcome(0)
    'runs away'
    """

    _stored: ClassVar = ("starts", "numbers", "basins", "cost")
    starts: Array
    numbers: NDArray[np.int64]
    basins: tuple[Basin, ...]
    cost: Cost
    _look: Look | None

    def __post_init__(self) -> None:
        self.starts.setflags(write=False)
        self.numbers.setflags(write=False)

    @property
    def error(self) -> Array:
        """Standard errors of the fractions, (number of basins,), if the starts are random."""
        return np.array([basin.error for basin in self.basins])

    def __len__(self) -> int:
        return len(self.basins)

    def __repr__(self) -> str:
        shown = [f"{basin.label} {basin.count}" for basin in self.basins]
        for number, text in OTHER_ENDS.items():
            count = int((self.numbers == number).sum())
            shown += [f"{text} {count}"] if count else []
        sizes = " x ".join(map(str, self.numbers.shape))
        return f"<Basins: {sizes} starts; {', '.join(shown)}>"

    def _facts(self) -> Facts:
        counts = {text: int((self.numbers == n).sum()) for n, text in OTHER_ENDS.items()}
        return {
            "system": self._look and system_repr(self._look.system, 6),
            "starts": " x ".join(map(str, self.numbers.shape)),
            **{text: count or None for text, count in counts.items()},
            "cost": self.cost,
        }

    def _tables(self) -> list[str]:
        rows = [(b.number, b.label, b.count, b.fraction, largest(b.error)) for b in self.basins]
        heads = ("attractor", "label", "starts", "fraction", "error")
        return [table("Attractors", rows, heads)] if rows else []

    def outcome(self, *place: int) -> str:
        """Return the outcome of one start in words: the label of its attractor, or why it has none.

        Parameters
        ----------
        place : int
            Indices of the start: two, or one for starts in a row.

        Raises
        ------
        ValueError
            When there is no such start.
        """
        number = int(self.numbers[self._place(place)])
        return OTHER_ENDS[number] if number < 0 else str(self.basins[number].label)

    def attractor(self, *place: int) -> Attractor:
        """Simulate one start again and return its attractor, the same bits.

        Parameters
        ----------
        place : int
            Indices of the start: two, or one for starts in a row.

        Raises
        ------
        ValueError
            When there is no such start, or the basins were loaded without their system.
        NoMotion
            When there is no motion from the start.
        """
        if self._look is None:
            raise ValueError("system must be given to Basins.load to get motions back; got None")
        return self._look.motion(self.starts[self._place(place)])

    @property
    def coordinates(self) -> Sequence[str]:
        """Names of the numbers of a start, (s,); ``start[0]`` and so on without a system."""
        if self._look is None:
            return [f"start[{i}]" for i in range(self.starts.shape[-1])]
        names: Sequence[str] = self._look.system.start_names
        return names

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the basins, and return the axes.

        A grid of starts, (k1, k2, s), is drawn as regions, with the attractors of two-dimensional
        maps. For a row of starts, (k, s), the fractions are drawn with their standard errors.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        """
        from dynkit.sweeps.basins.drawing import draw_basins

        return draw_basins(self.basins, self.starts, self.numbers, self.coordinates, ax)

    def _page(self, motions: int) -> Page:
        from dynkit.sweeps.basins.drawing import page_of

        return page_of(self, motions)

    def dataset(self) -> Dataset:
        """Return the numbers of the starts' attractors, and the attractors, as a dataset.

        Dimensions are ``start``, or ``row`` and ``column`` for a grid of starts, ``coordinate`` of
        the starts, and ``attractor``.
        """
        over = ("row", "column") if self.numbers.ndim == 2 else ("start",)
        meanings: dict[str, Any] = {f"number_{i}": text for i, text in OTHER_ENDS.items()}
        return Dataset(
            {"attractor": ("attractor", np.arange(len(self)))},
            {
                "number": (over, self.numbers),
                "position": ((*over, "coordinate"), self.starts),
                "label": ("attractor", np.array([str(b.label) for b in self.basins], dtype=str)),
                "count": ("attractor", np.array([basin.count for basin in self.basins], int)),
                "fraction": ("attractor", np.array([basin.fraction for basin in self.basins])),
                "error": ("attractor", self.error),
            },
            described(
                "Basins of attraction",
                cost=self.cost,
                error="standard error of the fraction of starts that were drawn at random",
                system=self._look and self._look.system,
                **meanings,
            ),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the basins to a store (HDF5). After a failure the old file remains.

        Raises
        ------
        ValueError
            When the file cannot be written, or the basins were loaded without their system.
        """
        if self._look is None:
            raise ValueError("system must be given to Basins.load to store them again; got None")
        system = {"system": kind_of(self._look.system), **identity_of(self._look.system)}
        write_result(path, self, system | self._look.entries)

    @classmethod
    def load(cls, path: str | os.PathLike[str], system: Map | None = None) -> Basins:
        """Read basins from a store that `save` wrote: the same bits.

        A store of ``basins(store=...)`` holds finished starts instead: repeat the call to use it.

        Parameters
        ----------
        path : path
        system : Map, optional
            The system that was simulated; needed for `attractor`.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of basins, or was made with another
            system.
        """
        if system is not None:
            checked_map(system, Map)
        found, file, archive = read_result(path, cls)
        if system is None:
            return found
        refuse_other_system(file, archive, system)
        with understood(file, cls.__name__):
            counts = {name: int(archive.entries[name]) for name in ("transient", "keep")}
        look = look_at(system, found.starts.reshape(-1, found.starts.shape[-1]), **counts)
        return replace(found, _look=look)

    def _place(self, place: tuple[int, ...]) -> tuple[int, ...]:
        shape: tuple[int, ...] = self.numbers.shape
        if len(place) != len(shape):
            raise ValueError(f"place must have {len(shape)} indices; got {place}")
        return tuple(
            index_in(f"place[{i}]", own, 0, k - 1)
            for i, (own, k) in enumerate(zip(place, shape, strict=True))
        )
