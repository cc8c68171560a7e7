"""Figures 14 and 15: proper orthogonal modes, and the power that they hold."""

from __future__ import annotations

import numpy as np

from dynkit.analysis import POD
from dynkit.plotting.figures import new_figure, print_style, save_figure
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.measures.motions import Motion
from tutorials.cusumano_bai_1993.measures.transient import which_chaos
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop


def figure_14(workshop: Workshop) -> Section:
    """Make figure 14: the first four proper orthogonal modes beside the normal modes."""
    from matplotlib.figure import Figure

    watch = Stopwatch()
    with watch.time("motions"):
        pods = _pods(workshop)
    pod = pods[0][2]
    with watch.time("drawing"), print_style():
        figure = Figure(figsize=(6.8, 4.4), layout="constrained")
        panels = list(figure.subplots(2, 2, sharex=True).ravel())
        pod.plot_modes(panels, count=paper.MODES_14)
        save_figure(figure, workshop.folder / "figure-14")
    with watch.time("errors"):
        errors = [_assurance_error(motion) for _, motion, _ in pods]
    found = _assurance(pod)
    least = min(range(len(found)), key=lambda k: found[k][0])
    text = (
        f"Proper orthogonal modes of the {pods[0][1].name} at {paper.FIGURE_14:g}, each beside the "
        "normal mode of the chain in free flight that is most like it. MAC, the modal assurance "
        "criterion, is the squared cosine of the angle between the two. The paper calls the modes "
        "close to the normal ones at all parameters, and closer in strong chaos: here are those "
        f"of figure 15's motions too, with the normal mode beside each.\n\n"
        + table(
            [
                "frequency",
                "damping",
                "motion",
                *(f"MAC of mode {k + 1}" for k in range(len(found))),
                "error",
            ],
            [
                [
                    f"{frequency:g}",
                    f"{damping:g}",
                    motion.name,
                    *(f"{share:.4f} (normal {j})" for share, j in _assurance(each)),
                    f"{error:.1g}",
                ]
                for ((frequency, damping), motion, each), error in zip(pods, errors, strict=True)
            ],
        )
        + "\n\nThe error is half the largest distance between what the two halves of the motion "
        f"give. At {paper.FIGURE_14:g} modes 3 and {paper.MODES_14} hold "
        f"{100.0 * pod.power[2:4].sum() / pod.power.sum():.2g} % of the power; of the first "
        f"{paper.MODES_14} the least like a normal mode is mode {least + 1}, with {found[least][0]:.3f}."
    )
    return Section(
        "figure-14",
        "Figure 14: proper orthogonal and normal modes",
        text,
        [
            Finding(
                f"modes 1 to {paper.MODES_14} at {paper.FIGURE_14:g} beside the normal ones",
                "close",
                "MAC " + ", ".join(f"{share:.3f}" for share, _ in found),
                f"{errors[0]:.1g}",
            )
        ],
        ["figure-14"],
        watch.seconds,
    )


def figure_15(workshop: Workshop) -> Section:
    """Make figure 15: the cumulative power in the first modes."""
    watch = Stopwatch()
    with watch.time("motions"):
        pods = _pods(workshop)
    with watch.time("drawing"), print_style():
        figure, (axes,) = new_figure(height=2.8)
        for (frequency, damping), _, pod in pods:
            label = rf"$\omega = {frequency:g}$, $\gamma = {damping:g}$"
            pod.plot(axes, share=paper.SHARE, label=label)
        axes.legend(loc="lower right")
        save_figure(figure, workshop.folder / "figure-15")
    counts = [pod.rank(paper.SHARE) for _, _, pod in pods]
    theirs = [row.modes for case in paper.FIGURE_15 for row in paper.TABLE_1 if row[:2] == case]
    text = (
        "Share of the power in the first proper orthogonal modes; an arrow marks the number that "
        f"holds {paper.SHARE:.0%}. The motion at {paper.CHAOS:g} is "
        f"{which_chaos(workshop.long_runs)}: see Table 1.\n\n"
        + table(
            ["modes", *(f"{w:g}, damping {g:g}" for (w, g), _, _ in pods)],
            [
                [k + 1, *(f"{pod.cumulative[k]:.5f} ± {_error(pod, k)}" for _, _, pod in pods)]
                for k in range(paper.MASSES)
            ],
        )
    )
    return Section(
        "figure-15",
        "Figure 15: cumulative power",
        text,
        [
            Finding(
                "modes for 99 % at " + ", ".join(f"{w:g}" for w, _ in paper.FIGURE_15),
                ", ".join(str(count) for count in theirs),
                ", ".join(str(count) for count in counts),
                f"shares {100.0 * max(pod.cumulative_errors.max() for _, _, pod in pods):.1g} %",
                counts == theirs,
            )
        ],
        ["figure-15"],
        watch.seconds,
    )


def _pods(workshop: Workshop) -> list[tuple[tuple[float, float], Motion, POD]]:
    """Frequency and damping, motion, and decomposition, for each curve of figure 15."""
    found = []
    for case in paper.FIGURE_15:
        ends = case[0] == paper.CHAOS
        motion = workshop.transient if ends else workshop.settled(*case)
        found.append((case, motion, motion.pod))
    return found


def _assurance(pod: POD) -> list[tuple[float, int]]:
    """For each of the first modes its assurance, and the number of the normal mode beside it."""
    matrix = pod.modal_assurance()[: paper.MODES_14]
    return [(float(row.max()), int(row.argmax()) + 1) for row in matrix]


def _assurance_error(motion: Motion) -> float:
    """Half the largest distance between the assurances that the halves of a motion give."""
    record = motion.attractor.record
    first = record.system.simulate(impacts=len(record) // 2, start=record.start)
    second = record.system.simulate(impacts=len(record) // 2, start=first.final)
    one, other = (
        np.array([share for share, _ in _assurance(POD(half))]) for half in (first, second)
    )
    return float(abs(one - other).max()) / 2.0


def _error(pod: POD, k: int) -> str:
    return f"{pod.cumulative_errors[k]:.0e}"
