"""Settings that all tests share."""

import os

from tests.effort import register_profiles

# Figures are drawn without a display, also by the processes that tests start.
os.environ["MPLBACKEND"] = "Agg"

register_profiles()
