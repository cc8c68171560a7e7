"""Work that any `concurrent.futures.Executor` may do: chunks, results in any order, stores."""

from dynkit.engine.executors import WorkerLost

__all__ = ["WorkerLost"]
