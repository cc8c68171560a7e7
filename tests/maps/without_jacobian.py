"""Maps whose derivatives are taken away, so that they are found by differences."""

import dataclasses
from typing import Any

from dynkit.core.smooth_map import SmoothMap
from dynkit.dynamics.map import Map


def without_jacobian(system: SmoothMap) -> Any:
    """Return the same map with the defaults of `Map` for its derivatives."""
    given: Any = system
    kind = type(system)
    defaults = {"jacobian": Map.jacobian, "parameter_derivative": Map.parameter_derivative}
    values = {entry.name: getattr(system, entry.name) for entry in dataclasses.fields(given)}
    return type(kind.__name__, (kind,), defaults)(**values)
