"""What several figures are drawn with."""

from typing import Any

DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0.0}
"""Settings of a cloud of points; size and colour are the drawer's choice."""
