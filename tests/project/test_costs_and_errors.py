"""Whatever a user gets says what it cost and how wrong it may be, or is listed as no result."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import pytest

from dynkit import (
    Cost,
    ExponentialSum,
    MapAttractor,
    basins,
    continue_curve,
    continue_orbit,
    equilibrium,
    explore,
    find_orbits,
    parameter_map,
    periodic_orbit,
    sweep,
)
from dynkit.analysis import (
    BifurcationDiagram,
    CorrelationDimension,
    LyapunovSpectrum,
    PowerSpectrum,
)
from dynkit.systems import Henon, ImpactChain, Logistic, Lorenz, SingleImpactOscillator
from tests.public_classes import example, measures, public_classes
from tests.testing.test_problems import rest

SYSTEM = "a system: a call is as wrong as its `accuracy`, a motion as its record or attractor says"
OPTION = "an option: what the user says"
PAGE = (
    "a drawing of results, or a part of it; its motions are samples of theirs, to single precision"
)
VALUE = "a value inside a result, whose error and cost it shares"
ELEMENT = "what acts on a system, whose motions say it"
EQUATIONS = "equations and what they are made of; their solutions are the results"
RUNNING = "a measure that accumulates; its result says it"
STATE = "one state of a system, as wrong as its `accuracy`; to simulate from"

NO_RESULTS = {
    "BouncingBall": SYSTEM,
    "Brusselator": SYSTEM,
    "Chua": SYSTEM,
    "CompassGait": SYSTEM,
    "CompiledMap": SYSTEM,
    "Dataset": "arrays of a result, which carries its cost and error among the attributes",
    "DelayedLogistic": SYSTEM,
    "DoublePendulum": SYSTEM,
    "Duffing": SYSTEM,
    "ExponentialSum": SYSTEM,
    "Family": SYSTEM,
    "Flow": SYSTEM,
    "FoldedTowel": SYSTEM,
    "Henon": SYSTEM,
    "HenonHeiles": SYSTEM,
    "HybridFlow": SYSTEM,
    "ResetMap": SYSTEM,
    "RestrictedThreeBody": SYSTEM,
    "SimplestWalker": SYSTEM,
    "SymbolicHybridFlow": SYSTEM,
    "HighBounce": SYSTEM,
    "Ikeda": SYSTEM,
    "FPUTChain": SYSTEM,
    "ImpactChain": SYSTEM,
    "ImpactDuffing": SYSTEM,
    "ImpactPendulum": SYSTEM,
    "TodaChain": SYSTEM,
    "Element": ELEMENT,
    "HardStop": ELEMENT,
    "SoftStop": ELEMENT,
    "DryFriction": ELEMENT,
    "ImpactLaw": ELEMENT,
    "PlasticBelow": ELEMENT,
    "ViscoelasticSpheres": ELEMENT,
    "Jenkins": ELEMENT,
    "Regime": ELEMENT,
    "Watch": ELEMENT,
    "ImpactMap": SYSTEM,
    "ImpactOscillator": SYSTEM,
    "IntegratedFlow": SYSTEM,
    "LagrangianStructure": SYSTEM,
    "Logistic": SYSTEM,
    "Lorenz": SYSTEM,
    "Map": SYSTEM,
    "MatrixOscillator": SYSTEM,
    "SmoothMap": SYSTEM,
    "PlayOscillator": SYSTEM,
    "PoincareMap": SYSTEM,
    "Rossler": SYSTEM,
    "ImpactRod": SYSTEM,
    "SingleImpactOscillator": SYSTEM,
    "StandardMap": SYSTEM,
    "SymbolicFlow": SYSTEM,
    "SymbolicMap": SYSTEM,
    "ParametricPendulum": SYSTEM,
    "VanDerPol": SYSTEM,
    "ContinuationMethod": OPTION,
    "Corrector": OPTION,
    "StepControl": OPTION,
    "TestFunction": OPTION,
    "Hyperplane": OPTION,
    "ImpactMethod": OPTION,
    "PoincareSection": OPTION,
    "Stroboscope": OPTION,
    "Page": PAGE,
    "Cells": PAGE,
    "Series": PAGE,
    "Basin": VALUE,
    "Cost": VALUE,
    "Ending": VALUE,
    "Failure": VALUE,
    "Point": VALUE,
    "Estimate": VALUE,
    "Events": VALUE,
    "LabelInterval": VALUE,
    "Link": VALUE,
    "ExactImpacts": VALUE,
    "FoundImpacts": VALUE,
    "LocalSlopes": VALUE,
    "Measurement": VALUE,
    "RegimeChange": VALUE,
    "ScalingRegion": VALUE,
    "Unexplored": VALUE,
    "Crossing": STATE,
    "ImpactState": STATE,
    "Stretching": STATE,
    "Measures": "results by name, each with its error",
    "Running": RUNNING,
    "RunningExponents": RUNNING,
    "RunningHistogram": RUNNING,
    "RunningPOD": RUNNING,
    "RunningSample": RUNNING,
    "RunningSpectrum": RUNNING,
    "Stream": "a motion in blocks, which are attractors",
    "Condition": EQUATIONS,
    "Event": EQUATIONS,
    "FamilyProblem": EQUATIONS,
    "PeriodicProblem": EQUATIONS,
    "Problem": EQUATIONS,
    "WatchedProblem": EQUATIONS,
}


@cache
def attractor() -> Any:
    return SingleImpactOscillator(frequency=2.6, stop=0.1).attractor(impacts=80)


def logistic(rate: float) -> MapAttractor:
    return MapAttractor(Logistic(rate=rate), np.array([0.3]), 100, 20)


@cache
def branch() -> Any:
    orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    return continue_orbit(orbit, "a", bounds=(0.1, 0.5))


RESULTS: dict[str, Callable[[], Any]] = {
    **{name: partial(example, kind) for name, kind in measures().items()},
    "Basins": lambda: basins(Logistic(rate=3.2), [[-0.1], [0.3], [0.5]], progress=False),
    "Bifurcation": lambda: branch().bifurcations[0],
    "Criticality": lambda: branch().bifurcations[0].criticality,
    "BifurcationCurve": lambda: continue_curve(
        branch().bifurcations[0], ("a", "b"), bounds=((0.0, 3.0), (-0.9, 0.9)), points=3
    ),
    "BifurcationDiagram": lambda: BifurcationDiagram.of(RESULTS["Sweep"]()),
    "Branch": branch,
    "CorrelationSums": lambda: (
        CorrelationDimension(np.random.default_rng(0).uniform(size=(2000, 1))).sums
    ),
    "Equilibrium": lambda: equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0]),
    "FamilySolution": rest,
    "EnergyBalance": lambda: ImpactChain(frequency=0.87).simulate(impacts=9).energy_balance(),
    "Harmonics": lambda: PowerSpectrum(attractor()).lines,
    "ImpactAttractor": attractor,
    "ImpactOrbit": lambda: attractor().periodic_orbit(),
    "ImpactOrbit, sticking": lambda: ImpactChain(
        masses=1, frequency=0.408, restitution=0.3
    ).periodic_orbit(sticking=True),
    "ImpactRecord": lambda: attractor().record,
    "LyapunovSpectrum": lambda: LyapunovSpectrum(attractor(), iterations=1000),
    "MapAttractor": lambda: logistic(3.2),
    "MapOrbit": lambda: periodic_orbit(Logistic(rate=3.9), [0.1], period=3),
    "Modes": lambda: ImpactChain(masses=3, frequency=0.87).modes,
    "Network": lambda: explore(
        Logistic(rate=2.5), "rate", (2.4, 3.3), seeds=[periodic_orbit(Logistic(rate=2.5), [0.6])]
    ),
    "OrbitLabel": lambda: attractor().label,
    "OrbitSearch": lambda: find_orbits(Logistic(rate=3.9), 3, [(0.0, 1.0)]),
    "ParameterMap": lambda: parameter_map(
        Henon(), {"a": [0.2, 1.2], "b": [0.0, 0.3]}, start=[0.1, 0.1], exponents=99, progress=False
    ),
    "Root": lambda: ExponentialSum([1.0], [0.0], [1.0], [0.0]).first_root(),
    "SecondMoments": lambda: attractor().second_moments(),
    "Sweep": lambda: sweep(
        SingleImpactOscillator(frequency=2.6, stop=0.1), "frequency", [2.5, 2.6], progress=False
    ),
}
"""How to make one of each: of measures as the example of the class does."""


@cache
def made(name: str) -> Any:
    """A result, which the tests share."""
    return RESULTS[name]()


MADE = {name.partition(",")[0] for name in RESULTS}
"""Their classes."""

ABSTRACT = {"Attractor", "PeriodicOrbit", "ProblemSolution"}
"""Results that others are made of: what is abstract cannot be made."""


def test_every_public_class_is_a_result_or_listed_as_none() -> None:
    found = {kind.__name__: place for kind, place in public_classes().items()}
    known = NO_RESULTS.keys() | MADE | ABSTRACT
    assert not {name: place for name, place in found.items() if name not in known}


def test_what_is_listed_is_met_by_users_and_listed_once() -> None:
    results = MADE | ABSTRACT
    never_met = (NO_RESULTS.keys() | results) - {kind.__name__ for kind in public_classes()}
    assert not never_met
    assert not NO_RESULTS.keys() & results


@pytest.mark.parametrize("kind", [k for k in public_classes() if k.__name__ not in NO_RESULTS])
@pytest.mark.parametrize("member", ["cost", "error"])
def test_cost_and_error_of_results_are_documented(kind: type, member: str) -> None:
    text = " ".join(inspect.getdoc(getattr(base, member, None)) or "" for base in kind.__mro__)
    own = re.search(rf"^( *|.*, ){member}(,.*)? : ", inspect.getdoc(kind) or "", re.MULTILINE)
    assert own or len(text) > 12


@pytest.mark.parametrize("name", RESULTS)
def test_results_have_a_cost_and_an_error(name: str) -> None:
    result = made(name)
    assert type(result).__name__ == name.partition(",")[0]
    assert isinstance(result.cost, Cost)
    error = np.asarray(result.error, dtype=float)
    assert error.size
    assert not (error < 0.0).any()
    assert not np.isnan(error).any()


@pytest.mark.parametrize("name", ["Branch", "ImpactOrbit", "MapOrbit", "ImpactOrbit, sticking"])
def test_each_multiplier_has_an_error(name: str) -> None:
    result = made(name)
    error = result.multipliers_error
    assert error.shape == result.multipliers.shape
    assert (error >= 0.0).all()
    assert (error < 1e-6).all()
    assert not error.flags.writeable


def test_nothing_is_known_of_multipliers_of_an_impact_that_only_grazes() -> None:
    orbit = made("ImpactOrbit")
    grazing = orbit.problem().orbit(
        orbit.unknowns * np.repeat([1.0, 0.0], orbit.impacts), np.empty(0), (0.0,)
    )
    assert np.isinf(grazing.multipliers_error).all()


@pytest.mark.parametrize("name", RESULTS)
def test_whatever_results_hold_is_known(name: str) -> None:
    """What annotations do not tell: the classes of the values of all properties."""
    result = made(name)
    known = NO_RESULTS.keys() | MADE
    for member in dir(type(result)):
        described = inspect.getattr_static(type(result), member)
        if member.startswith("_") or not isinstance(described, property | cached_property):
            continue
        value = getattr(result, member)
        kind = type(value[0] if isinstance(value, tuple | list) and len(value) else value)
        if kind.__module__.startswith("dynkit"):
            bases = {base.__name__ for base in kind.__mro__}
            assert bases & (known | {"Enum"}), f"{name}.{member} is a {kind.__name__}"
