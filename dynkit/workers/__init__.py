"""Work that any `concurrent.futures.Executor` may do: chunks, results in any order, stores."""

from dynkit.workers.executing import WorkerLost

__all__ = ["WorkerLost"]
