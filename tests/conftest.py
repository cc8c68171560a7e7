"""Settings that all tests share."""

import gc
import os

import pytest

from tests.effort import register_profiles

# What is collected stays to the end: it is not searched for garbage, again and again.
gc.disable()

# Figures are drawn without a display, also by the processes that tests start.
os.environ["MPLBACKEND"] = "Agg"

# Pages for the browser open nothing.
os.environ["BROWSER"] = "true"

register_profiles()

APART = (
    "tests/reference/",
    "tests/flows/",
    "tests/structure/",
    "tests/tutorials/",
)
"""Without the kernels of impacts, and then long."""


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
