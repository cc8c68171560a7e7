"""Calls that an executor makes ahead of time, for results that may be asked for or not."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, TypeVar, final

from dynkit.engine.executors import NotSendable, Outcome, WorkerLost, outcome_of, pack, submit

_Result = TypeVar("_Result")

MOST = 256
"""So many calls are with the executor at most."""


@final
class Ahead:
    """Results of calls, by key; each call depends on nothing but itself, and is picklable.

    Parameters
    ----------
    executor : Executor or None
        None: nothing is done ahead.
    """

    def __init__(self, executor: Executor | None) -> None:
        self._executor = executor
        self._futures: dict[Hashable, Future[Outcome[Any]]] = {}

    def __contains__(self, key: Hashable) -> bool:
        return key in self._futures

    @property
    def has_room(self) -> bool:
        """Whether another call may begin."""
        return self._executor is not None and len(self._futures) < MOST

    def begin(self, key: Hashable, call: Callable[[], object]) -> None:
        """Let the call be made, unless there is no executor, no room, or it was begun before."""
        if self._executor is not None and self.has_room and key not in self._futures:
            self._futures[key] = submit(self._executor, pack(_Call(call)), None)

    def seen(self, key: Hashable) -> Any:
        """Return the result if it is there already, and None otherwise."""
        future = self._futures.get(key)
        if future is None or not future.done():
            return None
        return outcome_of(future).result

    def result(self, key: Hashable, call: Callable[[], _Result]) -> _Result:
        """Return the result of the call, made here when it was not begun.

        Raises
        ------
        WorkerLost
            When the executor cannot make it.
        Exception
            What the call raises.
        """
        future = self._futures.pop(key, None)
        if future is None:
            return call()
        outcome: Outcome[_Result] = outcome_of(future)
        if isinstance(outcome.error, NotSendable):  # no refusal of the call itself
            raise WorkerLost(str(outcome.error)) from outcome.error
        return outcome.value()

    def drop(self, key: Hashable) -> None:
        """Forget a call that is not needed."""
        future = self._futures.pop(key, None)
        if future is not None:
            future.cancel()

    def close(self) -> None:
        """Forget all calls."""
        for key in list(self._futures):
            self.drop(key)


@final
@dataclass(frozen=True, eq=False)
class _Call:
    call: Callable[[], object]

    def __call__(self, _: None) -> object:
        return self.call()
