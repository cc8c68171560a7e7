"""Settings that all tests share."""

import os

from hypothesis import settings

# Figures are drawn without a display, also by the processes that tests start.
os.environ["MPLBACKEND"] = "Agg"

# The first example of a test may compile a kernel: no deadline.
settings.register_profile("dynkit", deadline=None, print_blob=True)
settings.load_profile("dynkit")
