"""Branches of impact oscillators: every point, and where they end or bend, against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import continue_curve, continue_orbit
from dynkit.continuation.results.branch import Branch
from dynkit.systems import (
    ImpactChain,
    ImpactOscillator,
    MatrixOscillator,
    SingleImpactOscillator,
    SoftStop,
)
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact.one_mass import periodic_orbits
from tests.impact_orbits.exact_orbits import distance, exact_orbit, one_impact_orbits

ASKED = 1e-9
"""Largest distance from the closed form, of states and of multipliers relative to the largest."""


def one_mass(**parameters: Any) -> ImpactChain:
    return ImpactChain(masses=1, harmonic_forces=(0j,), **parameters)


ONE_MASS = {
    "frequency": (one_mass(frequency=2.5), 1, "frequency", (1.3, 4.0)),
    "far table": (one_mass(frequency=2.5, offset=-0.05), 1, "frequency", (1.3, 4.0)),
    "near table": (one_mass(frequency=2.5, offset=0.04, damping=0.3), 2, "frequency", (1.3, 4.0)),
    "restitution": (one_mass(frequency=2.5), 1, "restitution", (0.1, 1.0)),
    "offset": (one_mass(frequency=2.5), 1, "offset", (-1.0, 1.0)),
    "damping": (one_mass(frequency=2.5, restitution=0.6), 1, "damping", (0.01, 3.0)),
}


def points(branch: Branch, count: int) -> Any:
    return np.unique(np.linspace(0, len(branch) - 1, count).astype(int)).tolist()


@pytest.mark.parametrize("name", ONE_MASS)
def test_points_of_branches_of_one_mass_are_the_closed_form(name: str) -> None:
    system, periods, parameter, bounds = ONE_MASS[name]
    branch = continue_orbit(system.periodic_orbit(periods=periods), parameter, bounds=bounds)
    assert len(branch) > 20
    compared = 0
    for i in points(branch, 60):
        orbit = branch.orbit(i)
        assert isinstance(orbit, ImpactOrbit)
        if orbit.unknowns[1] <= 1e-6:
            continue  # the closed form has orbits that push only
        exact = periodic_orbits(orbit.system, periods)
        off = [abs(system.difference(orbit.states[0], found.state)).max() for found in exact]
        k = int(np.argmin(off))
        assert off[k] <= ASKED
        wanted = sorted(exact[k].multipliers, key=abs)
        found = sorted(branch.multipliers[i], key=abs)
        assert distance(found, wanted) <= ASKED * max(1.0, abs(wanted[-1]))
        assert branch.stable[i] == exact[k].stable
        compared += 1
    assert compared > 20


CHAINS: dict[str, tuple[ImpactOscillator, int, str, tuple[float, float]]] = {
    "ten masses": (ImpactChain(frequency=0.87), 3, "frequency", (0.7, 1.1)),
    "far table": (ImpactChain(frequency=0.87, offset=-0.03), 3, "frequency", (0.75, 1.0)),
    "two masses": (ImpactChain(masses=2, frequency=1.4), 2, "restitution", (0.2, 1.0)),
    "little damping": (
        ImpactChain(masses=3, frequency=0.9, damping=0.01),
        2,
        "damping",
        (0.005, 1),
    ),
}


@pytest.mark.parametrize("name", CHAINS)
def test_points_of_branches_of_chains_are_the_closed_form(name: str) -> None:
    system, periods, parameter, bounds = CHAINS[name]
    branch = continue_orbit(system.periodic_orbit(periods=periods), parameter, bounds=bounds)
    for i in points(branch, 5):
        orbit = branch.orbit(i)
        assert isinstance(orbit, ImpactOrbit)
        if orbit.unknowns[1] <= 1e-6:
            continue
        off = [
            abs(system.difference(orbit.states[0], np.asarray(found.state, dtype=float))).max()
            for found in one_impact_orbits(orbit.system, periods)
        ]
        assert min(off) <= ASKED
        exact = exact_orbit(orbit)
        largest = abs(branch.multipliers[i]).max()
        assert distance(branch.multipliers[i], exact.multipliers) <= ASKED * max(1.0, largest)


def test_the_grazing_curve_in_frequency_and_force_is_that_of_the_linear_response() -> None:
    system = SingleImpactOscillator(frequency=2.0, stop=0.4, force=2.0, restitution=0.8)
    branch = continue_orbit(system.periodic_orbit(), "force", bounds=(0.2, 4.0))
    (start,) = (b for b in branch.bifurcations if b.kind == "GR" and abs(b.unknowns[1]) < 1e-9)
    assert abs(start.value - system.grazing_force) <= 1e-10
    curve = continue_curve(start, ("frequency", "force"), bounds=((1.3, 3.5), (0.2, 6.0)))
    assert np.ptp(curve.parameters[:, 0]) > 1.0
    for frequency, force in curve.parameters.tolist():
        assert abs(force - system.replace(frequency=frequency).grazing_force) <= 1e-10 * force


def test_a_branch_passes_a_resonance_a_hundred_times_as_high_as_its_begin() -> None:
    force, dashpot, far = 0.02, 0.01, SoftStop(0, offset=-100.0, stiffness=1.0)
    alone: Any = {"M": [[1.0]], "C": [[dashpot]], "K": [[1.0]], "harmonic_forces": [force]}
    machine = MatrixOscillator(frequency=0.1, elements=[far], **alone)
    orbit = machine.attractor(transient=300).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.05, 2.0))
    w = branch.parameter
    assert (w[0], w[-1]) == (0.05, 2.0)
    assert len(branch) < 700

    def exact(w: Any) -> Any:
        response = force / (1.0 - w**2 + 1j * dashpot * w)
        return np.array([0.0 * w, response.imag, (1j * w * response).imag])

    # a point is as far from the curve, in its units and in that of the parameter
    units = np.array([branch.problem.scale(x) for x in branch.unknowns]).T
    slopes = np.gradient(exact(w), w, axis=1)
    allowed = branch.error * (units + abs(slopes) * np.ptp(w))
    assert (abs(branch.unknowns.T - exact(w)) <= allowed).all()
