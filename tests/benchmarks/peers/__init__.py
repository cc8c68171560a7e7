"""Other ways to simulate impacts, for `WorkPrecision`: dynkit's peers."""

from __future__ import annotations

from collections.abc import Sequence

from dynkit.analysis import ImpactMethod, impact_methods
from tests.benchmarks.peers.heyoka import Heyoka
from tests.benchmarks.peers.moreau import MoreauTimeStepping
from tests.benchmarks.peers.paper import PaperAlgorithm
from tests.benchmarks.peers.siconos import Siconos


def all_methods(names: Sequence[str] | None = None) -> list[ImpactMethod]:
    """Return the methods that come with dynkit, and its peers.

    ``paper`` is closed-form motion with Newton's method from a sampled bracket, ``Moreau`` steps
    through impacts, ``heyoka`` and ``Siconos`` are libraries that may be installed or not.

    Parameters
    ----------
    names : sequence of str, optional
        Some of them; by default all.

    Raises
    ------
    ValueError
        When a name is unknown.
    """
    own, *integrators = impact_methods()
    known = [own, PaperAlgorithm(), *integrators, MoreauTimeStepping(), Heyoka(), Siconos()]
    by_name = {method.name: method for method in known}
    for name in names or ():
        if name not in by_name:
            raise ValueError(f"methods must hold names among {', '.join(by_name)}; got {name!r}")
    return [by_name[name] for name in by_name if names is None or name in names]


NAMES = tuple(method.name for method in all_methods())
"""dynkit's own maps, then its peers."""
