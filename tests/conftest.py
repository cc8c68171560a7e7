"""Settings that all tests share."""

import gc
import os
from collections.abc import Iterator

import pytest

from tests.benchmarks.report import time_once
from tests.effort import optimised_code, quick_code, register_profiles

# What is collected stays to the end: it is not searched for garbage, again and again.
gc.disable()

# Figures are drawn without a display, also by the processes that tests start.
os.environ["MPLBACKEND"] = "Agg"

# Pages for the browser open nothing.
os.environ["BROWSER"] = "true"

register_profiles()
quick_code()
time_once()

APART = (
    "tests/reference/",
    "tests/flows/",
    "tests/structure/",
    "tests/tutorials/",
)
"""Without the kernels of impacts, and then long."""


@pytest.fixture
def optimised() -> Iterator[None]:
    """Compile Taylor's method as for users; other tests compile it in a tenth of the time."""
    with optimised_code():
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The second of two workers, which begins in the middle, waits for no kernel to be compiled.

    While it runs what needs none, the first one compiles them for both; short tests come last.
    """
    apart = [item for item in items if item.nodeid.startswith(APART)]
    others = [item for item in items if not item.nodeid.startswith(APART)]
    middle = len(items) // 2
    items[:] = others[:middle] + apart + others[middle:]


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
