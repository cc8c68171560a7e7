"""Equilibria on both sides of a fold, of one sign and at one value of the parameter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import continue_orbit, equilibrium, explore
from dynkit.systems import SymbolicFlow


class Folded(SymbolicFlow):
    """A parabola with a fold at p = 0, and equilibria x = 2 -+ sqrt(p), y = x^2."""

    p: float = 0.5

    def velocity(self, x: Any, y: Any) -> Any:
        return self.p - (x - 2) ** 2, x**2 - y


class Parted(SymbolicFlow):
    """Two curves of equilibria that never meet: x = p and x = 1 + p."""

    p: float = 0.5

    def velocity(self, x: Any) -> Any:
        return (-(x - self.p) * (x - 1 - self.p),)


@pytest.mark.parametrize("p", [0.1, 0.25, 0.5, 0.9])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("step", [0.01, 0.04])
def test_a_branch_that_passes_below_its_start_is_not_closed(
    p: float, side: float, step: float
) -> None:
    x = 2.0 + side * np.sqrt(p)
    start = equilibrium(Folded(p=p), [x, x**2])
    branch = continue_orbit(start, "p", bounds=(-1.0, 1.0), step=step)
    assert not branch.closed
    assert [ending.reason.name for ending in branch.endings] == ["BOUND", "BOUND"]
    assert np.sort(branch.unknowns[[0, -1], 0]) == pytest.approx([1.0, 3.0], abs=1e-12)
    assert [str(found.kind) for found in branch.bifurcations] == ["SN"]


def test_each_curve_of_equilibria_of_one_sign_is_explored_once() -> None:
    seeds = [equilibrium(Parted(p=p), [x]) for p in (0.3, 0.5) for x in (p, 1.0 + p)]
    network = explore(Parted(), "p", (0.2, 0.9), seeds=seeds)
    assert len(network.branches) == 2
    folded = [equilibrium(Folded(p=p), [2 + s * p**0.5, 4.0]) for p in (0.3, 0.5) for s in (-1, 1)]
    assert len(explore(Folded(), "p", (-1.0, 1.0), seeds=folded).branches) == 1


@pytest.mark.parametrize("bound", [1e-6, 1e-4, 1e-3, 3e-3, 0.01])
@pytest.mark.parametrize("step", [0.003, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("p", [0.2, 0.5, 0.77])
def test_a_branch_ends_at_a_bound_before_the_fold_beyond_it(
    p: float, step: float, bound: float
) -> None:
    x = 2.0 + np.sqrt(p)
    start = equilibrium(Folded(p=p), [x, x**2])
    branch = continue_orbit(start, "p", bounds=(bound, 1.0), step=step, largest_step=4.0 * step)
    assert branch.bifurcations == ()
    assert np.sort(branch.unknowns[[0, -1], 0]) == pytest.approx([2.0 + bound**0.5, 3.0], abs=1e-9)
