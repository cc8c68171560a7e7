"""Pages of small results, and what a reader without a browser finds in them."""

from __future__ import annotations

import base64
import json
import re
from functools import cache
from typing import Any

import numpy as np

from dynkit import (
    Basins,
    BifurcationCurve,
    Branch,
    Network,
    Page,
    ParameterMap,
    Sweep,
    basins,
    continue_curve,
    continue_orbit,
    explore,
    parameter_map,
    periodic_orbit,
    sweep,
)
from dynkit.systems import Henon, ImpactChain

CHAIN = ImpactChain(masses=2, frequency=0.87)


@cache
def swept() -> Sweep:
    values = np.linspace(0.8, 1.0, 9)
    return sweep(CHAIN, "frequency", values, transient=200, keep=12, progress=False)


@cache
def branch() -> Branch:
    orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    return continue_orbit(orbit, "a", bounds=(0.1, 1.4))


@cache
def curve() -> BifurcationCurve:
    doubling = next(b for b in branch().bifurcations if b.kind == "PD")
    return continue_curve(doubling, ("a", "b"), bounds=((0.0, 3.0), (-0.9, 0.9)))


@cache
def branch_of_impacts() -> Branch:
    orbit = CHAIN.periodic_orbit(impacts=1, periods=1)
    return continue_orbit(orbit, "frequency", bounds=(0.8, 1.0))


@cache
def border() -> BifurcationCurve:
    grazing = next(b for b in branch_of_impacts().bifurcations if b.kind == "GR")
    bounds = ((0.8, 1.0), (0.6, 1.0))
    return continue_curve(grazing, ("frequency", "restitution"), bounds=bounds)


@cache
def network() -> Network:
    orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    return explore(Henon(a=0.2, b=0.3), "a", (0.1, 1.0), iterates=2, seeds=[orbit])


@cache
def plane() -> ParameterMap:
    values = {"a": np.linspace(0.2, 1.2, 7), "b": np.linspace(0.1, 0.3, 5)}
    return parameter_map(Henon(), values, start=[0.0, 0.0], progress=False)


@cache
def grid() -> Basins:
    x = np.linspace(-1.5, 1.5, 8)
    starts = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    return basins(Henon(a=1.0, b=0.3), starts, progress=False)


def data_of(page: Page) -> Any:
    """The data of a page as its script reads them."""
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page.html())

    def unpacked(value: Any) -> Any:
        if "bdata" not in value:
            return value
        return np.frombuffer(base64.b64decode(value["bdata"]), f"<{value['dtype']}")

    return json.loads(text, object_hook=unpacked)


def many(count: int) -> Page:
    """A page of points on a curve, without motions."""
    x = np.linspace(0.0, 1.0, count)
    none = np.zeros(count, dtype=np.int64)
    return Page("many points", ("x", "y"), none, none, {"x": x}, np.arange(count), x, x * (1.0 - x))
