"""Table 1: proper orthogonal modes, dimensions and Lyapunov exponents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.measures.motions import warm_up
from tutorials.cusumano_bai_1993.measures.rows import (
    DIMENSIONS,
    EXPONENTS,
    MODES,
    NONE,
    Line,
    dimensions_of,
    exponents_of,
    found_dimension,
    modes_of,
    scaling_of,
)
from tutorials.cusumano_bai_1993.measures.transient import VERY_LONG
from tutorials.cusumano_bai_1993.section import LOOKED_INTO, Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

# A local slope is told where its error is below this part of it.
_KNOWN = 0.05


def table_1(workshop: Workshop) -> Section:
    """Make Table 1."""
    watch = Stopwatch()
    with watch.time("compiling or loading kernels"):
        warm_up(workshop.chain(paper.STICKING[0]))
    with watch.time(f"long runs at {paper.CHAOS:g}"):
        assert workshop.long_runs
    lines = _lines(workshop, watch)
    text = "\n\n".join(
        [
            _about_modes(lines),
            table(MODES, [modes_of(line) for line in lines]),
            _about_dimensions(),
            table(DIMENSIONS, [dimensions_of(line) for line in lines]),
            _about_slopes(lines),
            _about_exponents(lines),
            table(EXPONENTS, [exponents_of(line) for line in lines]),
            "### Where this and the paper's Table 1 are apart",
            "\n".join(f"- {each}" for each in apart(lines)) or "Nowhere.",
        ]
    )
    return Section(
        "table-1",
        "Table 1: modes, dimensions and exponents",
        text,
        _findings(lines),
        seconds=watch.seconds,
    )


def _lines(workshop: Workshop, watch: Stopwatch) -> list[Line]:
    lines = []
    for row in paper.TABLE_1:
        if row.frequency == paper.CHAOS:
            lines.append(_timed(watch, row, workshop, ends=True))
            row = paper.Row(row.frequency, row.damping, NONE, None)
        lines.append(_timed(watch, row, workshop))
        if row.frequency == paper.TABLE_1_CHAOS:
            lines.append(_timed(watch, row._replace(frequency=paper.TEXT_CHAOS), workshop))
    return lines


def _timed(watch: Stopwatch, row: paper.Row, workshop: Workshop, *, ends: bool = False) -> Line:
    """A line with all measures worked out, those of chaos that ends when it does."""
    work = f"{row.frequency:g}" if row.damping == paper.DAMPING else f"at damping {row.damping:g}"
    work += " in chaos" if ends else ""
    with watch.time(work):
        motion = workshop.transient if ends else workshop.settled(row.frequency, row.damping)
        assert motion.pod.power.any()
        assert motion.dimension.sums.total
        assert motion.dimension.error >= 0.0
        assert motion.spectrum.exponents.any()
    return Line(row, motion, watch.seconds[work])


# --- words ----------------------------------------------------------------------------------------


def _about_modes(lines: Sequence[Line]) -> str:
    chaos, after = (line.motion for line in lines if line.row.frequency == paper.CHAOS)
    ends = after.label.periods is not None
    return (
        f"N is the number of proper orthogonal modes that hold {paper.SHARE:.0%} of the power, "
        "from the time average of $x x^T$ in closed form over the kept impacts, not from samples. "
        "Twice an error is the half-width of a 95 % interval. Labels are those of motions "
        "on which the chain settles from the paper's start. At "
        f"{paper.CHAOS:g} the paper's row speaks of "
        f"{'a transient' if ends else 'chaos that no run leaves'}: its first line here is that "
        f"of the {len(chaos.attractor.record)} impacts that the longest of the runs stays chaotic, "
        f"its second that of the motion {'that follows' if ends else f'after {VERY_LONG} impacts'}. "
        "What is said of "
        f"{paper.TABLE_1_CHAOS:g} in the paper's table is held against {paper.TEXT_CHAOS:g} too, "
        "the frequency in its text."
    )


def _about_dimensions() -> str:
    return (
        "d is the correlation dimension of the points of the section: positions and velocities of "
        "the free masses, relative velocity and phase just after impact, in the maximum norm. The "
        "scaling range is the largest radius over the smallest, 4:1 at least; the largest that "
        "is looked at in chaos is a tenth of the largest extent of positions and velocities: only "
        "the phase tells states that are farther apart. The error is one standard error. A "
        "periodic motion meets the section in n points, which have dimension 0: that is what is "
        "computed. The paper lists 1.00, which is the dimension of the closed orbit in time. The "
        "impacts "
        "of a sticking motion accumulate where it sticks; such a sequence has dimension 0 too, "
        "and as far as double precision tells its points apart they are finitely many. "
        "The Kaplan-Yorke dimension, of the same section, is one of information, which no "
        "correlation dimension exceeds. Where there is no scaling range the bounds are its."
    )


def _about_slopes(lines: Sequence[Line]) -> str:
    without = [line for line in lines if line.motion.dimension.region is None]
    if not without:
        return ""
    n = max(len(line.motion.dimension.states) for line in without)
    limit = (
        "Dimensions beyond 2 log10 n or so cannot be had from n points, "
        f"{2.0 * np.log10(n):.0f} from {n}, whatever a slope says (Eckmann & Ruelle, Physica D "
        "56 (1992) 185-187)."
    )
    return " ".join([*map(_slopes_of, without), limit])


def _slopes_of(line: Line) -> str:
    row, dimension = line.row, line.motion.dimension
    slopes = dimension.local_slopes
    where = f"At {row.frequency:g} with damping {row.damping:g} no range of 4:1 scales"
    relative = slopes.errors / slopes.values
    if row.scaling is None or not len(relative):
        return f"{where}."
    known = max(_KNOWN, float(relative.min()))
    first = int(np.flatnonzero(relative <= known)[0])
    last = int(np.searchsorted(slopes.radii, row.scaling * slopes.radii[first], side="right")) - 1
    short = dimension.region_over(row.scaling)
    return (
        f"{where}. The paper has "
        f"{row.dimension:g} ± {row.error:g} over {row.scaling:g}:1; a range as short as that "
        + ("does not scale either" if short is None else f"has the slope {short.slope:.1f}")
        + f": from radius {slopes.radii[last]:.3g} down to {slopes.radii[first]:.3g}, the least "
        f"where it is known to {known:.0%}, the local slope goes from {slopes.values[last]:.1f} ± "
        f"{slopes.errors[last]:.1g} to {slopes.values[first]:.1f} ± {slopes.errors[first]:.1g}."
    )


def _about_exponents(lines: Sequence[Line]) -> str:
    (chaos,) = [line.motion for line in lines if line.ends]
    lost = [
        f"{line.row.frequency:g} with damping {line.row.damping:g}"
        for line in lines
        if line.motion.spectrum.dimension == np.isfinite(line.motion.spectrum.exponents).sum()
    ]
    most = (
        f" At {' and '.join(lost)} the sum of all exponents that are finite is positive: there "
        "Kaplan and Yorke's dimension is all that contacts leave, as each contact loses two "
        "directions for good."
        if lost
        else ""
    )
    return (
        "The paper has no exponents. Those here are from exact derivatives; twice an error "
        "is the half-width of a 95 % interval. Those of the chaos at "
        f"{paper.CHAOS:g} are of one run while it is chaotic "
        f"({len(chaos.attractor.record)} impacts).{most} The seconds are those of the motion and "
        "all its measures."
    )


# --- what was found -------------------------------------------------------------------------------


def _held(lines: Sequence[Line]) -> list[Line]:
    """The line that each of the paper's rows is held against."""
    listed = [line for line in lines if line.row.modes is not None]
    return [line for line in listed if line.row.frequency != paper.TABLE_1_CHAOS]


def apart(lines: Sequence[Line]) -> list[str]:
    """Return what is found otherwise than the paper's rows say, a sentence or two for each."""
    parts = []
    for line in lines:
        row, found = line.row, line.motion
        at = f"{row.frequency:g}, damping {row.damping:g}"
        looked = f' (see "{LOOKED_INTO}")' if row.frequency in paper.LOOKED_INTO else ""
        if line.ends:
            (after,) = [each for each in lines if each.row.frequency == row.frequency][1:]
            if not paper.agrees(row.orbit, after.motion.name):
                parts.append(
                    f"{at}: the paper {row.orbit}, found {after.motion.name}. The runs are "
                    f"{found.name} after those that are skipped{looked}. N is {line.modes} in "
                    f"the chaos and {after.modes} after it."
                )
        elif row.orbit != NONE and not paper.agrees(row.orbit, found.name):
            parts.append(f"{at}: the paper {row.orbit}, found {found.name}{looked}.")
        if row.modes not in (None, line.modes):
            pod = found.pod
            held = 100.0 * pod.cumulative[row.modes - 1]
            parts.append(
                f"{at}: N is {line.modes}, not {row.modes}; {row.modes} modes hold {held:.2f} % "
                f"± {100.0 * pod.cumulative_errors[row.modes - 1]:.1g} %."
            )
        if row.dimension is not None and found.label.iterates is None:
            parts += _dimension_apart(line, at)
    return parts


def _dimension_apart(line: Line, at: str) -> list[str]:
    theirs, dimension = line.row, line.motion.dimension
    assert theirs.dimension is not None
    words = f"{at}: dimension {found_dimension(dimension)}"
    if dimension.region is None or dimension.points is not None:
        return [f"{words}, the paper {theirs.dimension:g} ± {theirs.error:g} (see above)."]
    error = float(np.hypot(dimension.error, theirs.error or 0.0))
    if abs(dimension.value - theirs.dimension) <= 2.0 * error:
        return []
    spectrum = line.motion.spectrum
    found = (
        f"{words} ± {dimension.error:.1g} over {scaling_of(dimension)}, the paper "
        f"{theirs.dimension:g} ± {theirs.error:g} over {theirs.scaling:g}:1. The Kaplan-Yorke "
        f"dimension is {spectrum.dimension:.2f} ± {spectrum.dimension_error:.1g}."
    )
    return [found]


def _findings(lines: Sequence[Line]) -> list[Finding]:
    held = _held(lines)
    error = max(
        float(line.motion.pod.cumulative_errors[line.modes - 2 : line.modes].max()) for line in held
    )
    within = sum(line.within for line in held)
    findings = [
        Finding(
            "modes for 99 % of the power, row by row",
            ", ".join(str(line.row.modes) for line in held),
            ", ".join(str(line.modes) for line in held),
            f"shares {100.0 * error:.1g} %",
            all(line.row.modes == line.modes for line in held),
        ),
        Finding(
            "2N + 1 within the bounds of the dimension",
            f"{paper.WITHIN} of {len(paper.TABLE_1)} rows",
            f"{within} of {len(held)} rows",
            "that of the dimensions",
            within == paper.WITHIN,
        ),
    ]
    for line in held:
        row, motion = line.row, line.motion
        if row.orbit == "chaotic" or motion.label.iterates is None:
            damping = "" if row.damping == paper.DAMPING else f", damping {row.damping:g}"
            known = motion.dimension.bounds is not None
            findings.append(
                Finding(
                    f"dimension at {row.frequency:g}{damping}",
                    f"{row.dimension:g} ± {row.error:g}",
                    f"{found_dimension(motion.dimension)}; Kaplan-Yorke "
                    f"{motion.spectrum.dimension:.2f}",
                    (f"{motion.dimension.error:.1g}; " if known else "")
                    + f"{motion.spectrum.dimension_error:.1g}",
                    not _dimension_apart(line, ""),
                )
            )
    return findings
