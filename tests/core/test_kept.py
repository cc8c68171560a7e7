"""Results that methods and properties keep with their objects."""

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np

import dynkit
from dynkit.core.kept import cached_property, kept
from dynkit.core.parameters import cached_in, without_cached

FUNCTOOLS = r"functools(\.| import .*\b)cached_property"


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


def test_what_is_kept_is_found_by_one_hash() -> None:
    """To hash the arguments, such as modes of a machine, takes longer than to find the result."""
    hashed = []

    class Mode:
        def __hash__(self) -> int:
            hashed.append(self)
            return 1

    asked, mode = Asked(), Mode()
    asked.of(mode)
    hashed.clear()
    asked.of(mode)
    assert hashed == [mode]


def test_results_are_read_only() -> None:
    assert not Asked().of(1).flags.writeable


def test_what_is_kept_is_no_attribute_of_the_object() -> None:
    asked = Asked()
    asked.of(1)
    assert "_kept" in cached_in(Asked)
    assert without_cached(asked) == {"times": 1}


class Meeting:
    """Computes its value when so many threads are at it."""

    def __init__(self, barrier: Barrier) -> None:
        self.barrier = barrier

    @cached_property
    def value(self) -> object:
        self.barrier.wait(timeout=30.0)
        return object()


def found_by_two(one: Meeting, other: Meeting) -> list[object]:
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda owner: owner.value, (one, other)))


def test_threads_compute_a_cached_property_of_two_objects_at_the_same_time() -> None:
    barrier = Barrier(2)
    one, other = found_by_two(Meeting(barrier), Meeting(barrier))
    assert one is not other


def test_threads_that_compute_a_cached_property_of_one_object_get_the_same_result() -> None:
    owner = Meeting(Barrier(2))
    one, other = found_by_two(owner, owner)
    assert one is other is owner.value


def test_no_module_has_the_property_whose_lock_all_objects_share() -> None:
    parts = [Path(dynkit.__file__).parent / name for name in ("", "systems", "analysis")]
    modules = {path.resolve() for part in parts for path in part.rglob("*.py")}
    shared = [path.name for path in modules if re.search(FUNCTOOLS, path.read_text("utf-8"))]
    assert len(modules) > 300
    assert shared == ["kept.py"]
