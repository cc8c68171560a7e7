"""Stands in `dynkit.figures`."""

from dynkit.figures import *  # noqa: F403
