"""Results that methods keep with their objects."""

from typing import Any

import numpy as np

from dynkit.core.kept import kept
from dynkit.core.parameters import cached_in, without_cached


class Asked:
    def __init__(self) -> None:
        self.times = 0

    @kept
    def of(self, *given: Any) -> Any:
        self.times += 1
        return np.array([float(np.size(one)) for one in given])


def test_each_set_of_arguments_is_computed_once() -> None:
    asked = Asked()
    given = [(), (1,), ((1, 2), "a"), (np.array([1.0, 2.0]),), (1, np.array([1.0, 2.0]))]
    for one in given:
        assert asked.of(*one) is asked.of(*one)
    assert asked.times == len(given)


def test_arrays_count_by_their_numbers() -> None:
    asked, numbers = Asked(), np.array([1.0, 2.0])
    first = asked.of(numbers)
    assert asked.of(numbers.copy()) is first
    numbers[0] = 3.0
    assert asked.of(numbers) is not first


def test_results_are_read_only() -> None:
    assert not Asked().of(1).flags.writeable


def test_what_is_kept_is_no_attribute_of_the_object() -> None:
    asked = Asked()
    asked.of(1)
    assert "_kept" in cached_in(Asked)
    assert without_cached(asked) == {"times": 1}
