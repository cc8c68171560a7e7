"""Fields of a subclass are its parameters, with or without the decorator of dataclasses."""

import dataclasses
import inspect
import pickle
from typing import ClassVar

import numpy as np
import pytest

from dynkit import Map, sweep
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain


class Shifted(Map):
    """A logistic map with a shift; it has no decorator."""

    rate: float
    shift: float = 0.0
    calls: ClassVar[int] = 0
    dimension = 1

    def __call__(self, state: Array) -> Array:
        return self.rate * state * (1.0 - state) + self.shift

    def jacobian(self, state: Array) -> Array:
        return np.array([[self.rate * (1.0 - 2.0 * state[0])]])


class Further(Shifted):
    """Another field, of a subclass."""

    more: float = 2.0


@dataclasses.dataclass(frozen=True)
class Decorated(Shifted):
    """With the decorator, and a field that is no argument."""

    hidden: float = dataclasses.field(default=1.0, init=False, repr=False)


class Grounded(ImpactChain):
    """A chain with a parameter more."""

    ground: float = 0.05


def shifted(*values: float, **named: float) -> Map:
    return Shifted(*values, **named)


def grounded(**named: float) -> ImpactChain:
    return Grounded(**named)  # type: ignore[arg-type]


def test_a_field_of_a_subclass_is_a_parameter_without_a_decorator() -> None:
    system = shifted(3.2, shift=0.1)
    assert system.parameters == {"rate": 3.2, "shift": 0.1}
    assert repr(system.replace(rate=3.5)) == "Shifted(rate=3.5, shift=0.1)"
    assert system == shifted(3.2, 0.1) != shifted(3.2)
    assert grounded(frequency=0.9, ground=0.3).parameters["ground"] == 0.3
    assert Further(3.2, more=1.0).parameters == {"rate": 3.2, "shift": 0.0, "more": 1.0}
    assert Decorated(3.2).parameters == {"rate": 3.2, "shift": 0.0}  # type: ignore[call-arg]
    assert "shift" in inspect.signature(Shifted).parameters


def test_such_a_class_is_frozen_and_says_what_it_lacks() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        shifted(3.2).rate = 2.0  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'rate'"):
        shifted()
    with pytest.raises(ValueError, match="parameter must be one of: rate, shift; got 'growth'"):
        shifted(3.2).replace(growth=1.0)


def test_it_can_be_swept_and_sent(tmp_path: object) -> None:
    found = sweep(shifted(3.2), "shift", [0.0, 0.01], start=[0.3], progress=False)
    assert [str(label) for label in found.labels] == ["P(2)", "P(2)"]
    system = pickle.loads(pickle.dumps(grounded(frequency=0.9, ground=0.2)))
    assert system == grounded(frequency=0.9, ground=0.2)
