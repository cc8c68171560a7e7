"""Names that are lists, and arrays with rows of different lengths: refused by name."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import Branch, basins, continue_curve, continue_orbit, periodic_orbit, sweep
from dynkit.systems import HardStop, Henon, ImpactChain

RAGGED: Any = [[1, 2], [3]]
EMPTY: Any = np.empty((0, 3))


@cache
def _branch() -> Branch:
    return continue_orbit(periodic_orbit(Henon(a=0.2), [0.6, 0.2]), "a", bounds=(0.1, 1.0))


def _chain(**arguments: Any) -> ImpactChain:
    return ImpactChain(masses=2, frequency=1.0, **arguments)


CALLS: dict[str, tuple[Callable[[Any], Any], list[Any], str]] = {
    "continue_orbit": (
        lambda name: continue_orbit(_branch().orbit(0), name, bounds=(0.1, 1.0)),
        [[], {}, EMPTY, RAGGED],
        "parameter must be one of: a, b; got",
    ),
    "sweep": (
        lambda name: sweep(Henon(), name, [1.0, 1.1]),
        [[], {}, EMPTY],
        "parameter must be one of: a, b; got",
    ),
    "Branch.observable": (
        lambda name: _branch().observable(name),
        [[], {}, EMPTY],
        "name must be one of: .* got",
    ),
    "ImpactRecord.observable": (
        lambda name: _chain().simulate(impacts=2).observable(name),
        [[], {}, EMPTY],
        "name must be one of: .* got",
    ),
    "basins": (lambda starts: basins(Henon(), starts), [RAGGED], "starts must be an array"),
    "bounds": (
        lambda bounds: continue_curve(_branch().bifurcations[0], ("a", "b"), bounds=bounds),
        [RAGGED, 1.0],
        "bounds.* must",
    ),
    "coordinate": (HardStop, [RAGGED], "coordinate must be an array of real numbers; got"),
    "harmonic_forces": (
        lambda forces: _chain(harmonic_forces=forces),
        [RAGGED],
        "harmonic_forces must be an array of complex numbers; got",
    ),
    "elements": (
        lambda elements: _chain(elements=elements),
        [EMPTY, []],
        "elements must hold one element at least; got none",
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_it_is_refused_by_name(name: str) -> None:
    call, odd, message = CALLS[name]
    for value in odd:
        with pytest.raises(ValueError, match=message):
            call(value)
