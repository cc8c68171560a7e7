"""The two resonances of figure 6, which the paper leaves open: what they are, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynkit import Sweep
from dynkit.plotting.figures import save_figure
from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.resonances.branches import Ridge, contacts_of, ridge
from tutorials.cusumano_bai_1993.resonances.causes import (
    FINE,
    HIGH,
    LOW,
    RULES,
    Resonance,
    bilinear,
    chains,
    drive,
    holding_force,
    mismatch,
    modes_of,
    resonance,
    spread,
)
from tutorials.cusumano_bai_1993.resonances.figure import draw
from tutorials.cusumano_bai_1993.resonances.search import longer
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

ITEM = "resonances"

_BRANCHES = (
    "peak, paper", "orbit", "lower end", "upper end", "largest energy at", "energy", "multiplier",
    "contact",
)  # fmt: skip

# Ratios of frequencies that are so near those of a string, relative, are like them.
_LIKE = 0.06
# A third resonance is looked for so near three times the bilinear frequency, relative.
_THIRD, _NEAR = 3, 0.05


def resonances(workshop: Workshop) -> Section:
    """Follow the orbits of both resonances, and hold their frequencies against what may make them.

    Their branches in frequency, what stands beside the ends, searches for P(inf,4), and the same
    resonances in other chains.
    """
    watch = Stopwatch()
    with watch.time("sweep"):
        sweep = workshop.sweep
    chain = workshop.chain(paper.STICKING[0])
    with watch.time("branches"):
        ridges = [ridge(chain, peak) for peak in paper.PEAKS]
    with watch.time("motions beside them"):
        parts = [_about_branches(ridges, sweep)]
        findings = [_found(each) for each in ridges]
    with watch.time("searches"):
        text, finding = longer(chain, ridges[-1])
        parts.append(text)
        findings.append(finding)
    with watch.time("other chains"):
        found = [_of_ridge(each, chain) for each in ridges]
        for name, other in chains(workshop).items():
            found += [resonance(name, other, each.periods) for each in ridges]
    text, causes = _causes(workshop, chain, ridges, found)
    parts.append(text)
    findings += causes
    with watch.time("drawing"):
        save_figure(draw(ridges, sweep), workshop.folder / ITEM, 300.0)
    return Section(ITEM, "The two resonances", "\n\n".join(parts), findings, [ITEM], watch.seconds)


# --- the branches -------------------------------------------------------------------------------


def _about_branches(ridges: Sequence[Ridge], sweep: Sweep) -> str:
    rows = []
    for each in ridges:
        at, error = each.top
        low, high = each.ends
        rows.append(
            [
                f"{each.peak:g}",
                each.branch.label,
                f"{low.kind} {low.value:.10f} ({low.error:.0e})",
                f"{high.kind} {high.value:.10f} ({high.error:.0e})",
                f"{at:.5f} ({error:.0e})",
                f"{each.highest.energy:.5f} ({each.error:.0e})",
                f"{each.moduli.min():.4f} to {each.moduli.max():.4f}",
                f"{100.0 * each.contacts.min():.1f} to {100.0 * each.contacts.max():.1f} %",
            ]
        )
    beside = [
        [
            each.branch.label,
            f"{motion.frequency:.7f}",
            motion.label,
            f"{motion.energy:.5f}",
            motion.contacts,
        ]
        for each in ridges
        for motion in each.beside
    ]
    stable = all(each.branch.stable.all() for each in ridges)
    gone = not any(motion.contacts for each in ridges for motion in each.beside)
    return (
        "### Branches\n\nNear each of the paper's peaks the chain sticks once in a period, and "
        "the orbit was continued in frequency, both ways to its ends. "
        f"{'All orbits on both branches are stable. ' if stable else ''}The table gives both ends, "
        "where the energy after impacts is largest and how large, the largest modulus of a "
        "multiplier along the branch, and the share of the period in contact after the chatter; "
        "errors in brackets. At an end of kind CB the chatter completes just as contact is "
        "lost. In "
        "the figure the lines are the largest energies and the contacts of the orbits, solid where "
        "they are stable, dashed where not; dots are all impacts and contacts of the sweep.\n\n"
        + table(_BRANCHES, rows)
        + "\n\n"
        + _unsettled(ridges, sweep)
        + "\n\nThe motions beyond the ends, started on the orbit at the end, with the number of "
        "contacts among the impacts kept: "
        + (
            "none sticks. The chatter does not complete any more, and has the fewer impacts the "
            "further the end is.\n\n"
            if gone
            else "\n\n"
        )
        + table(["branch", "frequency", "label", "energy", "contacts"], beside)
    )


def _unsettled(ridges: Sequence[Ridge], sweep: Sweep) -> str:
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    rows = []
    for each in ridges:
        inside = (sweep.values >= each.frequencies[0]) & (sweep.values <= each.frequencies[-1])
        for place in np.flatnonzero(inside).tolist():
            at = float(sweep.values[place])
            rows.append([f"{at:g}", f"{energies[place]:.5f}", f"{each.energy_at(at):.5f}"])
    return (
        "The largest energies of the sweep of figure 6a beside those of the branches: where they "
        f"differ, the motion has not settled after the {paper.TRANSIENT} skipped impacts, and that "
        "moves the peaks of the figure.\n\n" + table(["frequency", "sweep", "branch"], rows)
    )


def _found(each: Ridge) -> Finding:
    low, high = each.ends
    at, error = each.top
    return Finding(
        f"resonance at {each.peak:g}",
        "unexplained",
        f"{each.branch.label} from {low.value:.6f} to {high.value:.6f}, largest energy at {at:.5f}",
        f"ends {max(low.error, high.error):.0e}, largest energy {error:.0e}",
    )


# --- the cause ----------------------------------------------------------------------------------


def _of_ridge(each: Ridge, chain: ImpactChain) -> Resonance:
    at, error = each.top
    energy = each.highest.energy
    return Resonance("the paper's", each.periods, modes_of(chain), at, energy, error, True)


def _causes(
    workshop: Workshop, chain: ImpactChain, ridges: Sequence[Ridge], found: Sequence[Resonance]
) -> tuple[str, list[Finding]]:
    modes = modes_of(chain)
    rule = min(RULES, key=lambda name: spread(found, name)[0])
    typical, largest = spread(found, rule)
    own = [each.deviation(rule) for each in found[: len(ridges)]]
    text = (
        "### Why there\n\nIn flight the chain has the natural frequencies $w_i$ of Table A1, and "
        "others, $W_i$, while its tip is held by the table. Neither is near the resonances. "
        "But the motion takes turns: a flight, then chatter and contact. Half a period of each "
        "of the first modes makes the period of a bilinear oscillator, with frequency "
        f"$2 w_1 W_1 / (w_1 + W_1)$ = {bilinear(modes):.5f} here, from $w_1$ = {modes.free[0]:.5f} "
        f"and $W_1$ = {modes.stuck[0]:.5f}; the table may turn m times meanwhile. Where the energy "
        "is largest, on the grid of the branch:\n\n"
        + _durations(ridges, float(modes.free[0]), float(modes.stuck[0]))
        + "\n\nThe same in other chains, each swept as the paper did, from "
        f"{LOW:g} to {HIGH:g} of m bilinear frequencies. The frequency of the table over m at the "
        "largest energy, and how far that is above what several rules say, in %: the wave goes "
        "along all springs three times in a period, twice in flight and once in contact. The error "
        f"of frequencies found is the step, {100.0 * FINE:g} %, besides what has not settled; for "
        "the paper's chain they are those of the branches.\n\n"
        + _rules(found)
        + "\n\n"
        + _verdict(found, rule)
        + "\n\n"
        + _soft(workshop.sweep, ridges)
        + "\n\n"
        + _third(workshop, chain, found)
    )
    words = " and ".join(f"{100.0 * each:+.1f} %" for each in own)
    name = rule.replace("$", "")
    return text, [
        Finding(
            "cause of the resonances",
            "unexplained",
            f"{name} frequency times 1 and 2: {words} off; {100.0 * typical:.1f} % in "
            f"{len(found)} resonances of chains, {100.0 * largest:.0f} % at worst",
            f"{100.0 * FINE:g} % of each frequency",
        )
    ]


def _durations(ridges: Sequence[Ridge], free: float, stuck: float) -> str:
    rows = [
        [
            each.branch.label,
            f"{each.highest.flight:.3f}",
            f"{np.pi / free:.3f}",
            f"{each.highest.chatter:.3f} + {each.highest.contact:.3f}",
            f"{each.highest.chatter + each.highest.contact:.3f}",
            f"{np.pi / stuck:.3f}",
        ]
        for each in ridges
    ]
    heads = ["flight after the release", "$\\pi/w_1$", "chatter + contact", "sum", "$\\pi/W_1$"]
    return table(["orbit", *heads], rows)


def _rules(found: Sequence[Resonance]) -> str:
    rows = [
        [
            each.name,
            each.periods,
            f"{each.modes.free[1] / each.modes.free[0]:.2f}",
            f"{each.modes.stuck[1] / each.modes.stuck[0]:.2f}",
            f"{each.base:.5f}",
            "yes" if each.sticks else "no",
            *(f"{100.0 * each.deviation(rule):+.1f}" for rule in RULES),
        ]
        for each in found
    ]
    heads = ["chain", "m", "$w_2/w_1$", "$W_2/W_1$", "found", "sticks", *RULES]
    means = [f"{100.0 * spread(found, rule)[0]:.1f}" for rule in RULES]
    worst = [f"{100.0 * spread(found, rule)[1]:.1f}" for rule in RULES]
    rows += [["root mean square", *[""] * 5, *means], ["largest", *[""] * 5, *worst]]
    return table(heads, rows)


def _verdict(found: Sequence[Resonance], rule: str) -> str:
    far = max(found, key=lambda each: abs(each.deviation(rule)))
    like = [each for each in found if _string_like(each)]
    unlike = [each for each in found if not _string_like(each)]
    near, others = spread(like, rule), spread(unlike, rule)
    return (
        f"The rule that comes nearest is: {rule}. It holds within {100.0 * near[1]:.1f} % in the "
        f"{len(like)} cases where $w_2/w_1$ and $W_2/W_1$ are within "
        f"{100.0 * _LIKE:.0f} % of 3 and 2, whatever "
        f"length, damping and restitution, and within {100.0 * others[1]:.1f} % in the other "
        f"{len(unlike)}; it is furthest off for {far.name}. For uniform chains the wave comes to "
        "nearly the same as the bilinear frequency, and nearer the longer they are; uneven ones "
        "tell them apart.\n\n"
        "Why it should need these ratios: in a string that is held at one end $w_i$ are as 1, 3, "
        "5, ... and $W_i$ as 1, 2, 3, ... Half a period of $w_1$ then reverses the whole state, "
        "and the tip that has left the table at rest is back at rest: contact begins without "
        "impact, and nothing is lost but by the dashpots. Contact for half a period of $W_1$ "
        "reverses the odd ones of its modes, and so brings them back to the release. A uniform "
        "chain is nearly a string for its long waves. That the table turns once or twice meanwhile "
        "is no difference to the chain, only to the work that the table does."
    )


def _string_like(each: Resonance) -> bool:
    free, stuck = each.modes.free, each.modes.stuck
    ratios = np.array([free[1] / free[0] / 3.0, stuck[1] / stuck[0] / 2.0])
    return bool((abs(ratios - 1.0) < _LIKE).all())


def _soft(sweep: Sweep, ridges: Sequence[Ridge]) -> str:
    speeds = np.nanmax(abs(sweep.observable("relative_velocity")), axis=1)
    hardness = speeds / np.sqrt(2.0 * np.nanmax(sweep.observable("energy"), axis=1))
    places = [int(abs(sweep.values - each.top[0]).argmin()) for each in ridges]
    rest = float(np.median(hardness))
    there = " and ".join(f"{hardness[place]:.3f}" for place in places)
    return (
        "The impacts are soft indeed: the largest relative velocity after an impact, over the "
        f"velocity $\\sqrt{{2E}}$ that belongs to the largest energy, is {there} in the sweep of "
        f"figure 6a next to the largest energies of the two branches; its median along the sweep "
        f"is {rest:.3f}."
    )


def _third(workshop: Workshop, chain: ImpactChain, found: Sequence[Resonance]) -> str:
    modes, sweep = modes_of(chain), workshop.sweep
    at = _THIRD * bilinear(modes)
    turns = range(1, _THIRD + 1)
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    near = np.flatnonzero(abs(sweep.values / at - 1.0) <= _NEAR)
    forces = [f"{holding_force(chain, m * bilinear(modes)):.3f}" for m in turns]
    drives = [f"{drive(modes, m):.2f}" for m in turns]
    seen = "The sweep does not reach it."
    if len(near):
        top = int(near[energies[near].argmax()])
        inside = 0 < near.tolist().index(top) < len(near) - 1
        where = "inside" if inside else "at the edge of"
        sticks = sum(len(contacts_of(sweep, place)) > 0 for place in near.tolist())
        seen = (
            f"Within {100.0 * _NEAR:.0f} % of it the largest energy of the sweep is "
            f"{energies[top]:.5f}, at {sweep.values[top]:g}, {where} the interval, the motion "
            f"there is {sweep.label(top)}, and contacts were kept at {sticks} of the "
            f"{len(near)} frequencies."
        )
    name = "wall spring 0.2"
    other = chains(workshop)[name]
    elsewhere = resonance(name, other, _THIRD)
    heights = [f"{each.energy:.4f}" for each in found if each.name == name]
    force = holding_force(other, _THIRD * bilinear(elsewhere.modes))
    apart = [f"{mismatch(modes, m):.2f}" for m in turns]
    return (
        f"A third resonance would be at {_THIRD} bilinear frequencies, {at:.4f}. {seen} What "
        "keeps it away is open. The work is not what is missing: that of the table on a contact "
        "force of half a sine, at the best phase and with amplitude 1, is "
        f"{', '.join(drives)} amplitudes of the table for m = {', '.join(map(str, turns))}. Nor "
        f"alone that {at:.4f} is near $W_2$ = {modes.stuck[1]:.4f}, where the table shakes the "
        "held chain in resonance and the force that holds the tip to it swings by "
        f"{', '.join(forces)} amplitudes of the table: with {name} that is {force:.3f} for m = "
        f"{_THIRD}, and there is no third one either: from {LOW:g} to {HIGH:g} of three bilinear "
        f"frequencies the energy comes to {elsewhere.energy:.4f}, against {', '.join(heights)} "
        "before. What is left: a tip that comes back after half a period of $w_1$, "
        "its position and velocity reversed, finds the table elsewhere, by "
        f"{', '.join(apart)} amplitudes; soft contact asks for little.\n\n"
        "Open is also what decides the last per cent, and the larger deviations of uneven chains; "
        "and why short chains have the peaks without sticking."
    )
