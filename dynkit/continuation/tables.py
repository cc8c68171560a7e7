"""Tables of branches, curves and networks for notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynkit.continuation.bifurcations import shown
from dynkit.core.reprs import Facts, costing, span, table, told

if TYPE_CHECKING:
    from collections.abc import Iterable

    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.continuation.branch import Branch
    from dynkit.continuation.curves import BifurcationCurve
    from dynkit.continuation.network import Network


def bifurcation_table(bifurcation: Bifurcation) -> str:
    """Return a bifurcation as a table."""
    facts: Facts = [
        (bifurcation.parameter, f"{bifurcation.value:.12g}"),
        ("error", f"{bifurcation.error:.1e}"),
        ("critical multiplier", bifurcation.multiplier),
        ("admissible", _yes(bifurcation.admissible)),
        ("residual", f"{bifurcation.history[-1]:.1e}"),
        ("cost", costing(bifurcation.cost)),
    ]
    return table(f"Bifurcation {bifurcation.kind}", facts)


def branch_table(branch: Branch) -> str:
    """Return a branch, and its bifurcations, as tables."""
    count, system = len(branch), branch._system
    facts: Facts = [] if system is None else [("system", told(system, 6, [branch.name]))]
    facts += [
        (branch.name, span(branch.parameter)),
        ("points", count),
        ("stable", f"{branch.stable.sum()} of {count}"),
        ("admissible", f"{branch.admissible.sum()} of {count}"),
        ("begins where", branch.endings[0]),
        ("ends where", branch.endings[1]),
        ("residual", f"up to {branch.residuals.max():.1e}"),
    ]
    if "error" in vars(branch):
        facts.append(("error", f"up to {branch.error.max():.1e}"))
    facts.append(("cost", costing(branch.cost)))
    return table(f"Branch of {branch.label}", facts) + _found(branch.name, branch.bifurcations)


def _found(name: str, bifurcations: Iterable[Bifurcation]) -> str:
    rows = [
        (b.kind, f"{b.value:.12g}", f"{b.error:.1e}", b.multiplier, _yes(b.admissible))
        for b in bifurcations
    ]
    if not rows:
        return ""
    return table("Bifurcations", rows, ("kind", name, "error", "critical multiplier", "admissible"))


def _yes(admissible: bool) -> str:
    return "yes" if admissible else "no"


def curve_table(curve: BifurcationCurve) -> str:
    """Return a curve of bifurcations as a table."""
    facts: Facts = [
        (name, span(column)) for name, column in zip(curve.names, curve.parameters.T, strict=True)
    ]
    facts += [
        ("orbits", curve.label),
        ("points", len(curve)),
        ("admissible", f"{curve.admissible.sum()} of {len(curve)}"),
        ("begins where", curve.endings[0]),
        ("ends where", curve.endings[1]),
        ("residual", f"up to {curve.residuals.max():.1e}"),
    ]
    if "error" in vars(curve):
        facts.append(("error", f"up to {curve.error.max():.1e}"))
    return table(f"Curve of {curve.kind}", [*facts, ("cost", costing(curve.cost))])


def network_table(network: Network) -> str:
    """Return a network, and its branches, as tables."""
    facts: Facts = [
        ("branches", len(network)),
        ("bifurcations", len(network.bifurcations)),
        ("links", len(network.links)),
        ("unexplored", len(network.unexplored)),
        ("finish", network.message),
        ("cost", costing(network.cost)),
    ]
    rows = [
        (
            number,
            branch.label,
            span(branch.parameter),
            shown(branch.bifurcations),
        )
        for number, branch in enumerate(network.branches)
    ]
    name = network.branches[0].name if network.branches else "parameter"
    heads = ("branch", "orbits", name, "bifurcations")
    return table("Network", facts) + (table("Branches", rows, heads) if rows else "")
