"""Angles modulo 2 pi."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dynkit.core.validation import Array


def in_turn(angles: Any) -> Array:
    """Angles modulo 2 pi, in [0, 2 pi); an angle whose remainder is rounded to 2 pi becomes 0."""
    turned = np.asarray(angles) % math.tau
    return np.where(turned < math.tau, turned, 0.0)
