import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.systems import Henon, Logistic
from tests.example_systems import CircleRotation


def test_iterate_begins_with_the_state() -> None:
    assert Henon().iterate(np.array([0.1, 0.2]), 0).tolist() == [[0.1, 0.2]]


def test_iterate_is_the_closed_form_of_the_logistic_map() -> None:
    # x_n = sin^2(2^n theta) at rate 4
    theta = 0.3
    states = Logistic(4.0).iterate(np.array([np.sin(theta) ** 2]), 10)
    assert states[:, 0] == pytest.approx(np.sin(2.0 ** np.arange(11) * theta) ** 2, abs=1e-12)


def test_iterate_leaves_the_start_alone() -> None:
    start = np.array([0.1, 0.2])
    states = Henon().iterate(start, 3)
    assert not np.shares_memory(start, states)


@pytest.mark.parametrize("n", [-1, 1.0, True])
def test_iterate_refuses_what_is_no_count(n: int) -> None:
    with pytest.raises(ValueError, match="n must be zero or a positive integer; got "):
        Henon().iterate(np.zeros(2), n)


def test_iterate_refuses_a_start_that_is_not_finite() -> None:
    with pytest.raises(ValueError, match=r"state\[1\] must be a finite number; got nan"):
        Henon().iterate(np.array([0.0, np.nan]), 3)


def test_the_difference_of_plain_coordinates_is_a_subtraction() -> None:
    assert Henon().difference(np.array([1.0, 2.0]), np.array([3.0, 5.0])).tolist() == [-2.0, -3.0]


def test_the_difference_of_angles_is_the_shortest_way() -> None:
    rotation = CircleRotation(1.0)
    gap = rotation.difference(np.array([0.1, 0.0]), np.array([2 * np.pi - 0.1, 0.0]))
    assert gap[0] == pytest.approx(0.2)


def test_parameters_are_the_numbers_of_a_dataclass() -> None:
    assert Henon(a=1.2).parameters == {"a": 1.2, "b": 0.3}


def test_replace_changes_one_parameter() -> None:
    assert Henon().replace(a=1.2) == Henon(a=1.2, b=0.3)


def test_replace_without_names_changes_nothing() -> None:
    henon = Henon()
    assert henon.replace() is henon


def test_replace_refuses_unknown_names() -> None:
    with pytest.raises(ValueError, match="parameter must be one of: a, b; got 'c'"):
        Henon().replace(c=1.0)


class Shift(Map):
    """Not a dataclass, and without parameters."""

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        return state + 1.0

    def jacobian(self, state: Array) -> Array:
        return np.eye(1)


class ForgetfulShift(Shift):
    @property
    def parameters(self) -> dict[str, float]:
        return {"size": 1.0}


def test_a_map_without_parameters_refuses_every_name() -> None:
    with pytest.raises(
        ValueError, match=r"parameter must be a field of Shift, such as .*there is none; got 'size'"
    ):
        Shift().replace(size=2.0)


def test_parameters_without_a_replace_of_their_own_are_an_error_of_the_subclass() -> None:
    with pytest.raises(
        TypeError, match="ForgetfulShift has parameters but does not define `replace`"
    ):
        ForgetfulShift().replace(size=2.0)
