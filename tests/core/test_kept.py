"""Kept results in threads."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from dynkit.core.kept import cached_property


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
