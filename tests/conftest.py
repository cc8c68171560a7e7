"""Settings that all tests share."""

import gc
import os

from tests.effort import register_profiles

# What is collected stays to the end: it is not searched for garbage, again and again.
gc.disable()

# Figures are drawn without a display, also by the processes that tests start.
os.environ["MPLBACKEND"] = "Agg"

register_profiles()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
