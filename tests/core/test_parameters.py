"""Fields in the bodies of classes: parameters, and names that are taken."""

import re
from typing import Any

import numpy as np
import pytest

from dynkit import Map
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain, SymbolicMap


@pytest.mark.parametrize(
    ("base", "name", "owner"),
    [
        (ImpactChain, "stiffness", "LagrangianStructure"),
        (ImpactChain, "default_start", "ImpactMap"),
        (SymbolicMap, "iterate", "SmoothMap"),
        (Map, "attractor", "Map"),
    ],
)
def test_a_field_may_not_hide_what_its_bases_compute(base: Any, name: str, owner: str) -> None:
    limit = f"Own must not have a field '{name}': {owner} has a method or property of this name"
    with pytest.raises(TypeError, match=re.escape(limit)):
        type("Own", (base,), {"__annotations__": {name: float}, name: 1.0})


def test_a_field_may_be_what_its_bases_leave_open() -> None:
    class Doubling(Map):
        dimension: int = 1

        def __call__(self, state: Array) -> Array:
            return 2.0 * state % 1.0

    assert Doubling()(np.array([0.375])).tolist() == [0.75]
