"""The two resonances of figure 6, which the paper leaves open: what they are, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dynkit import Sweep
from dynkit.plotting.figures import save_figure
from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.resonances.branches import (
    Beside,
    Ridge,
    contacts_of,
    ridge,
    settled_energy,
)
from tutorials.cusumano_bai_1993.resonances.causes import (
    FINE,
    HIGH,
    LOW,
    RULES,
    Modes,
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
from tutorials.cusumano_bai_1993.section import Finding, Section, sentences, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

ITEM = "resonances"

_BRANCHES = (
    "peak, paper", "orbit", "lower end", "upper end", "largest energy at", "energy", "multiplier",
    "contact",
)  # fmt: skip

_TIMES = {1: "once", 2: "twice"}

# Ratios of frequencies that are so near those of a string, relative, are like them.
_LIKE = 0.06
# Energies that are the same to this part are that of one motion, as far as a figure shows.
_APART = 0.01
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
    title = f"The resonances near {' and '.join(f'{peak:g}' for peak in paper.PEAKS)}"
    return Section(ITEM, title, "\n\n".join(parts), findings, [ITEM], watch.seconds)


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
    stable = sum(int(each.branch.stable.sum()) for each in ridges)
    sticks = {each.sticks for each in ridges}
    count = sum(len(each.branch) for each in ridges)
    return (
        "### Branches\n\nNear each of the paper's peaks the orbit that the chain settles on, which "
        f"sticks {' and '.join(_TIMES.get(n, f'{n} times') for n in sorted(sticks))} in a period, was "
        "continued in frequency, both ways to its ends. "
        f"Of its {count} orbits {stable} are stable. The table gives both ends, "
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
        f"contacts among the impacts kept: {about_beside([each.beside for each in ridges])}\n\n"
        + table(["branch", "frequency", "label", "energy", "contacts"], beside)
    )


def about_beside(beside: Sequence[Sequence[Beside]]) -> str:
    """Return whether motions beyond ends stick, and whether impacts are fewer farther away.

    Parameters
    ----------
    beside : sequence of sequence of Beside
        Of each branch those below its lower end, then as many above its upper end, each from the
        nearest to the farthest.
    """
    motions = [motion for each in beside for motion in each]
    sticking = sum(motion.contacts > 0 for motion in motions)
    if sticking:
        return f"{sticking} of {len(motions)} stick."
    sides = [side for each in beside for side in (each[: len(each) // 2], each[len(each) // 2 :])]
    impacts = [[motion.label.iterates or 0 for motion in side] for side in sides]
    fewer = all(side[-1] > 0 and side == sorted(side, reverse=True) for side in impacts)
    return sentences(
        "none sticks. The chatter does not complete any more.",
        "It has the fewer impacts the further the end is." if fewer else "",
    )


def _unsettled(ridges: Sequence[Ridge], sweep: Sweep) -> str:
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    rows, apart, settled = [], 0, 0
    for each in ridges:
        inside = (sweep.values >= each.frequencies[0]) & (sweep.values <= each.frequencies[-1])
        for place in np.flatnonzero(inside).tolist():
            at = float(sweep.values[place])
            branch = each.energy_at(at)
            rows.append([f"{at:g}", f"{energies[place]:.5f}", f"{branch:.5f}"])
            if abs(energies[place] - branch) > _APART * branch:
                apart += 1
                settled += abs(settled_energy(sweep, place) - branch) <= _APART * branch
    peaks = [float(sweep.values[_highest_place(each, sweep)]) for each in ridges]
    return (
        "The largest energies of the sweep of figure 6a beside those of the branches. "
        f"{about_unsettled(len(rows), apart, settled)} The sweep has its largest energies "
        f"at {' and '.join(f'{peak:g}' for peak in peaks)}, the branches at "
        f"{' and '.join(f'{each.top[0]:.5f}' for each in ridges)}.\n\n"
        + table(["frequency", "sweep", "branch"], rows)
    )


def about_unsettled(count: int, apart: int, settled: int) -> str:
    """Return how many motions of so many have other energies, and how many of these settle later.

    Parameters
    ----------
    count, apart : int
        Motions, and those whose energy is not that of the branch.
    settled : int
        Those of the latter whose energy is that of the branch in the end.
    """
    words = f"They differ by more than {100.0 * _APART:g} % at {apart} of {count} frequencies"
    if not apart:
        return f"{words}."
    return (
        f"{words}, at {settled} of which the motion has not settled after the {paper.TRANSIENT} "
        "skipped impacts: after many more it has the energy of the branch."
    )


def _highest_place(each: Ridge, sweep: Sweep) -> int:
    """Where on the branch the sweep has its largest energy, or next to it."""
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    outside = (sweep.values < each.frequencies[0]) | (sweep.values > each.frequencies[-1])
    if outside.all():
        return int(abs(sweep.values - each.top[0]).argmin())
    return int(np.where(outside, -np.inf, energies).argmax())


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
        "others, $W_i$, while its tip is held by the table. "
        f"{about_nearest(modes, [each.top[0] for each in ridges])} "
        "The motion takes turns: a flight, then chatter and contact. Half a period of each "
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
        + verdict(found, rule)
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
            f"{name} frequency times {' and '.join(str(each.periods) for each in ridges)}: {words} "
            f"off; {100.0 * typical:.1f} % in "
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


def about_nearest(modes: Modes, found: Sequence[float]) -> str:
    """Return how far resonances are from natural frequencies, with the tip free and held."""
    natural = np.concatenate([modes.free, modes.stuck])
    distances = [float(abs(natural / each - 1.0).min()) for each in found]
    return (
        f"The nearest of them are {' and '.join(f'{100.0 * each:.0f} %' for each in distances)} "
        "from the resonances."
    )


def verdict(found: Sequence[Resonance], rule: str) -> str:
    """Return how well the rule that comes nearest holds, and where."""
    far = max(found, key=lambda each: abs(each.deviation(rule)))
    like = [each for each in found if _string_like(each)]
    unlike = [each for each in found if not _string_like(each)]
    near, others = (spread(each, rule)[1] if each else 0.0 for each in (like, unlike))
    names = ", ".join(dict.fromkeys(each.name for each in like))
    parts = [f"The rule that comes nearest is: {rule}."]
    if like:
        parts.append(
            f"It holds within {100.0 * near:.1f} % in the {len(like)} cases where $w_2/w_1$ and "
            f"$W_2/W_1$ are within {100.0 * _LIKE:.0f} % of 3 and 2 ({names})."
        )
    if unlike:
        parts.append(f"It holds within {100.0 * others:.1f} % in the other {len(unlike)}.")
    parts.append(f"It is furthest off for {far.name}.")
    if rule != "bilinear":
        return " ".join(parts)
    parts += [_about_wave(like, "where the ratios are so"), _about_wave(unlike, "in the others")]
    if not (like and unlike and near < others):
        return sentences(*parts)
    return (
        sentences(*parts) + "\n\n"
        "Why it should need these ratios: in a string that is held at one end $w_i$ are as 1, 3, "
        "5, ... and $W_i$ as 1, 2, 3, ... Half a period of $w_1$ then reverses the whole state, "
        "and the tip that has left the table at rest is back at rest: contact begins without "
        "impact, and nothing is lost but by the dashpots. Contact for half a period of $W_1$ "
        "reverses the odd ones of its modes, and so brings them back to the release. A uniform "
        "chain is nearly a string for its long waves. That the table turns m times meanwhile "
        "is no difference to the chain, only to the work that the table does."
    )


def _about_wave(found: Sequence[Resonance], where: str) -> str:
    """How far the frequency of the wave is from the bilinear one."""
    if not found:
        return ""
    apart = [abs(RULES["wave"](each.modes) / bilinear(each.modes) - 1.0) for each in found]
    return (
        f"The frequency of the wave is {100.0 * min(apart):.1f} to {100.0 * max(apart):.1f} % from "
        f"the bilinear one {where}."
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
        "The largest relative velocity after an impact, over the "
        f"velocity $\\sqrt{{2E}}$ that belongs to the largest energy, is {there} in the sweep of "
        f"figure 6a next to the largest energies of the branches; its median along the sweep "
        f"is {rest:.3f}: the impacts there are {softness(hardness[places].tolist(), rest)}."
    )


def softness(there: Sequence[float], rest: float) -> str:
    """Return whether impacts at some places are softer than elsewhere."""
    softer = sum(each < rest for each in there)
    if softer == len(there):
        return "softer than elsewhere"
    return "no softer than elsewhere" if not softer else "softer than elsewhere at some only"


def _third(workshop: Workshop, chain: ImpactChain, found: Sequence[Resonance]) -> str:
    modes, sweep = modes_of(chain), workshop.sweep
    at = _THIRD * bilinear(modes)
    turns = range(1, _THIRD + 1)
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    near = np.flatnonzero(abs(sweep.values / at - 1.0) <= _NEAR)
    seen, is_there = "The sweep does not reach it.", False
    if len(near):
        top = int(near[energies[near].argmax()])
        inside = 0 < near.tolist().index(top) < len(near) - 1
        where = "inside" if inside else "at the edge of"
        sticks = sum(len(contacts_of(sweep, place)) > 0 for place in near.tolist())
        is_there = inside and len(contacts_of(sweep, top)) > 0
        seen = (
            f"Within {100.0 * _NEAR:.0f} % of it the largest energy of the sweep is "
            f"{energies[top]:.5f}, at {sweep.values[top]:g}, {where} the interval, the motion "
            f"there is {sweep.label(top)}, and contacts were kept at {sticks} of the "
            f"{len(near)} frequencies."
        )
    begun = f"A third resonance would be at {_THIRD} bilinear frequencies, {at:.4f}. {seen}"
    if is_there:
        return f"{begun} So there is one, of motions that stick."
    name = "wall spring 0.2"
    other = chains(workshop)[name]
    elsewhere = resonance(name, other, _THIRD)
    return sentences(
        begun,
        "What keeps it away is open." if len(near) else "",
        about_drives([drive(modes, m) for m in turns]),
        f"Near it is $W_2$ = {modes.stuck[1]:.4f}, where the table shakes the held chain in "
        "resonance. The force that holds the tip to it swings by "
        f"{_listed(holding_force(chain, m * bilinear(modes)) for m in turns)} amplitudes of the "
        f"table for these m, and with {name} by "
        f"{holding_force(other, _THIRD * bilinear(elsewhere.modes)):.3f} for m = {_THIRD}: there, "
        f"from {LOW:g} to {HIGH:g} of three bilinear frequencies,",
        about_elsewhere(elsewhere.energy, [each.energy for each in found if each.name == name]),
        "A tip that comes back after half a period of $w_1$, its position and velocity reversed, "
        f"finds the table elsewhere, by {_listed(mismatch(modes, m) for m in turns)} amplitudes.",
    ) + _left_open(found)


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def about_drives(drives: Sequence[float]) -> str:
    """Return how much the table works for m = 1, 2, ..., and whether for the last it works least."""
    least = drives[-1] < min(drives[:-1])
    return (
        "The work of the table on a contact force of half a sine, at the best phase and with "
        f"amplitude 1, is {_listed(drives)} amplitudes of the table for m = "
        f"{', '.join(str(m) for m in range(1, len(drives) + 1))}: "
        f"{'it is least for the last' if least else 'it is not what is missing'}."
    )


def about_elsewhere(energy: float, before: Sequence[float]) -> str:
    """Return whether the energy of another chain has a third peak as high as those before."""
    heights = ", ".join(f"{each:.4f}" for each in before)
    words = f"the energy comes to {energy:.4f}, against {heights} of its resonances before"
    if energy < min(before):
        return f"{words}: there is no third one of that height either."
    return f"{words}: there is a third one."


def _left_open(found: Sequence[Resonance]) -> str:
    """What no rule here explains, a paragraph."""
    free = list(dict.fromkeys(each.name for each in found if not each.sticks))
    words = "\n\nOpen is also what decides what is left of the deviations"
    if not free:
        return f"{words}."
    return f"{words}, and why chains have the peaks without sticking ({', '.join(free)})."
