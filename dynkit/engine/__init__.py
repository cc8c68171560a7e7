"""Evaluation of many points by any `concurrent.futures.Executor`, with stores."""

from dynkit.engine.executors import WorkerLost

__all__ = ["WorkerLost"]
