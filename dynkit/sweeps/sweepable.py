"""What a system owes to be swept, and how every `Map` comes to offer it."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from inspect import getattr_static
from typing import Any, Protocol, Self, cast, final

import numpy as np

from dynkit.attractors import Attractor, MapAttractor
from dynkit.labels import OrbitLabel
from dynkit.maps import Map
from dynkit.results import Cost
from dynkit.showing import told
from dynkit.validation import Array, finite_array


class SweptAttractor(Protocol):
    """What the motion at one value of a sweep owes; its class is an `Attractor` too.

    1. `final`, the state from which the next value starts: of any type, the sweep only hands it on.
    2. `ending`, a member of an enumeration whose value is the text that the user reads.
    3. ``observable(name)``, (n,): one number per kept state; n is smaller than what was asked for
       when the motion ended early.
    4. `label`, `error` and `cost`, as every `Attractor`; the first two are worked out when they are
       asked for. ``label_within(budget)`` is the label as far as so many states tell.
    """

    @property
    def final(self) -> Any:
        """The state after the last one kept."""
        ...

    @property
    def ending(self) -> Enum:
        """Why the simulation ended."""
        ...

    @property
    def label(self) -> OrbitLabel:
        """What kind of motion it is."""
        ...

    @property
    def error(self) -> float:
        """How wrong the states may be."""
        ...

    @property
    def cost(self) -> Cost:
        """What the states cost."""
        ...

    def observable(self, name: str) -> Array:
        """Return one of the system's observables at the kept states, (n,)."""
        ...

    def label_within(self, budget: int) -> OrbitLabel:
        """Return the label as far as so many states tell."""
        ...


class Sweepable(Protocol):
    """What a system must implement to be swept; a plain `Map` needs nothing of it.

    1. `parameters`, its numbers by name, and ``replace(name=value)``, which refuses bad values with
       ValueError; it is called for all values before anything is simulated, so it must be cheap.
    2. `observables`, the names of what can be kept of a state; the first is kept by default.
    3. ``attractor(transient=, impacts=, start=)``: skips so many states, keeps so many, starting
       from a state of its own, from the `final` one at another value of the parameter, or, for
       None, from where it always starts. The same arguments give the same bits.
    4. ``pack_state(state)``, a one-dimensional array of finite floats, of one length at all values,
       and ``unpack_state(packed)``, the same state again, from which `attractor` gives the same
       bits. What `pack_state` gets from another value of the parameter it makes a state of its own
       first.
    5. ``displaced(motion, size)``, the final state of a motion, moved by this part of the motion's
       size: a fixed direction, the same at every call, which is in no symmetric subspace.
    6. `identity`, everything that the motion depends on, by name: numbers, strings, arrays, and
       tuples of them. A store made with another identity is refused.
    """

    @property
    def parameters(self) -> Mapping[str, float]:
        """The numbers that can be swept, by name."""
        ...

    @property
    def observables(self) -> Sequence[str]:
        """The names of what can be kept of a state."""
        ...

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that the motion depends on, by name."""
        ...

    def replace(self, **parameters: Any) -> Self:
        """Return the same system with some of its parameters changed."""
        ...

    def attractor(self, *, transient: int, impacts: int, start: Any) -> SweptAttractor:
        """Return the motion after a transient."""
        ...

    def pack_state(self, state: Any) -> Array:
        """Return the state as numbers."""
        ...

    def unpack_state(self, packed: Array) -> Any:
        """Return the state that the numbers stand for."""
        ...

    def displaced(self, motion: Any, size: float) -> Any:
        """Return the final state of a motion, moved by this part of the motion's size."""
        ...


def generic_direction(dimension: int) -> Array:
    """Return a direction, (d,), of length one without symmetry, always the same.

    It lies in no subspace that a symmetric system is likely to keep: square roots of different
    integers.
    """
    roots = np.sqrt(np.arange(2.0, 2.0 + dimension))
    return np.asarray(roots / np.linalg.norm(roots))


def sweepable(system: object) -> Sweepable:
    """Return what can be swept of a system.

    Raises
    ------
    ValueError
        When it is neither `Sweepable` nor a `Map`.
    """
    if isinstance(system, type):
        name = system.__name__
        raise ValueError(f"system must be an instance, such as {name}(...); got the class {name}")
    owed = [name for name in vars(Sweepable) if name[0] != "_"]
    missing = [name for name in owed if getattr_static(system, name, None) is None]
    if not missing:
        return cast("Sweepable", system)
    if isinstance(system, Map):
        return SweptMap(system)
    lacks = ", ".join(missing)
    raise ValueError(f"system must be a Map or Sweepable; got {system!r}, which lacks {lacks}")


def line_of(family: Sweepable | None, kind: str, swept: Collection[str] = ()) -> str:
    """Return a system in one line, without the parameters that were swept.

    Where it was not given, the name of its class alone, the last part of ``kind``.
    """
    if family is None:
        return kind.rpartition(".")[2]
    return told(family.map if isinstance(family, SweptMap) else family, 6, swept)


def as_attractor(motion: SweptAttractor) -> Attractor:
    """Return the motion as its user knows it."""
    return motion.attractor if isinstance(motion, _MapMotion) else cast("Attractor", motion)


class _Ending(Enum):
    COUNT_REACHED = "the number of states was reached"


@final
@dataclass(frozen=True, eq=False)
class SweptMap(Sweepable):
    """A plain map; its observables are the coordinates of its states."""

    map: Map

    @property
    def parameters(self) -> Mapping[str, float]:
        return self.map.parameters

    @property
    def observables(self) -> tuple[str, ...]:
        return tuple(f"state[{i}]" for i in range(self.map.dimension))

    @property
    def identity(self) -> Mapping[str, object]:
        instance: Any = self.map  # is_dataclass tells the type checker too much
        if not dataclasses.is_dataclass(instance):
            return self.map.parameters
        return {entry.name: getattr(instance, entry.name) for entry in dataclasses.fields(instance)}

    def replace(self, **parameters: Any) -> "SweptMap":
        return SweptMap(self.map.replace(**parameters))

    def attractor(self, *, transient: int, impacts: int, start: Any) -> "_MapMotion":
        return _MapMotion(MapAttractor(self.map, start, transient, impacts))

    def pack_state(self, state: Any) -> Array:
        return finite_array("start", state, (self.map.dimension,))

    def unpack_state(self, packed: Array) -> Array:
        return packed

    def displaced(self, motion: Any, size: float) -> Array:
        states = as_attractor(motion).states
        # a coordinate that is zero throughout has no size of its own; nor has a state that is zero
        largest = float(abs(states).max()) or 1.0
        return np.asarray(states[-1] + size * largest * generic_direction(states.shape[1]))


@final
@dataclass(frozen=True, eq=False)
class _MapMotion(SweptAttractor):
    attractor: MapAttractor

    @property
    def final(self) -> Array:
        return np.asarray(self.attractor.states[-1])

    @property
    def ending(self) -> Enum:
        return _Ending.COUNT_REACHED

    @property
    def label(self) -> OrbitLabel:
        return self.attractor.label

    @property
    def error(self) -> float:
        return self.attractor.error

    @property
    def cost(self) -> Cost:
        return self.attractor.cost

    def observable(self, name: str) -> Array:
        return self.attractor.states[:, int(name.removeprefix("state[").removesuffix("]"))]

    def label_within(self, budget: int) -> OrbitLabel:
        return self.attractor.label_within(budget)
