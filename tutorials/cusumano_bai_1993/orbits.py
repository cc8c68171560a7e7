"""Figures 7 to 12: three motions, each by series, spectrum and sections."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, lcm, pi
from typing import TYPE_CHECKING

import numpy as np

from dynkit import OrbitKind, OrbitLabel
from dynkit.analysis import ImpactSection, PowerSpectrum, StroboscopicSection, TimeSeries
from dynkit.plotting.figures import new_figure, print_style, save_figure
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.drawing import DOTS
from tutorials.cusumano_bai_1993.section import Finding, Section, sentences, table
from tutorials.cusumano_bai_1993.settling import FAR
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit import Harmonics
    from dynkit.systems import ImpactAttractor
    from tutorials.cusumano_bai_1993.arrays import Array

TWO_PI = 2.0 * pi

# Interval of a series; table periods in a segment of a spectrum, and segments. Of chaos more are
# needed, and quarters of them tell how far what is measured may be off.
_INTERVAL, _PERIODS, _SEGMENTS, _CHAOTIC_SEGMENTS, _QUARTERS = 0.05, 48, 8, 16, 4
# Bins that a line of a Hann window takes on each side, and what is drawn below the highest.
_LINE, _DECADES = 2.5, 8
# Points are the same when they are nearer to one another, relative to the farthest from zero.
_SAME = 1e-6
# Impacts for which two motions are followed; places from which they set out in chaos.
_FOLLOWED, _PLACES = 1000, 9
# Strongest harmonics that are listed.
_LISTED = 6


@dataclass(frozen=True)
class _Found:
    """What a spectrum tells: for the report, and in short with its error."""

    text: str
    short: str
    error: str


def figure_7(workshop: Workshop) -> Section:
    """Make figure 7: P(1,3), series and spectrum."""
    return _series_and_spectrum(workshop, 7, paper.SHOWN[7])


def figure_8(workshop: Workshop) -> Section:
    """Make figure 8: P(1,3), sections."""
    return _sections(workshop, 8, paper.SHOWN[7])


def figure_9(workshop: Workshop) -> Section:
    """Make figure 9: the sticking motion, series and spectrum."""
    return _series_and_spectrum(workshop, 9, paper.SHOWN[9])


def figure_10(workshop: Workshop) -> Section:
    """Make figure 10: the sticking motion, sections."""
    return _sections(workshop, 10, paper.SHOWN[9])


def figure_11(workshop: Workshop) -> Section:
    """Make figure 11: chaos, series and spectrum."""
    return _series_and_spectrum(workshop, 11, paper.SHOWN[11])


def figure_12(workshop: Workshop) -> Section:
    """Make figure 12: chaos, sections."""
    return _sections(workshop, 12, paper.SHOWN[11])


# --- series and spectrum --------------------------------------------------------------------------


def _series_and_spectrum(workshop: Workshop, number: int, motion: paper.Shown) -> Section:
    watch = Stopwatch()
    with watch.time("simulation"):
        attractor = workshop.shown(motion.frequency)
        label = attractor.label
    with watch.time("spectrum"):
        spectrum = _spectrum(attractor)
        lines = spectrum.lines
        found = (
            _broad(attractor, spectrum) if lines is None else _lines(motion, label, spectrum, lines)
        )
    with watch.time("drawing"), print_style():
        _draw_series(workshop, number, motion, attractor, spectrum)
    text = (
        f"{_origin(attractor)} Above: displacement of the tip (solid), table (dashed), impacts "
        "(dots). Below: power spectral density of that displacement by Welch's method, "
        f"{spectrum.segments} segments of {_PERIODS} table periods; grey lines are harmonics of "
        f"the table.\n\n{found.text}"
    )
    return Section(
        f"figure-{number}",
        f"Figure {number}: {_name(motion, label)} in time and frequency",
        text,
        [
            Finding(
                f"spectrum at {motion.frequency:g}",
                motion.spectrum,
                found.short,
                found.error,
                motion.periods == (None if lines is None else label.periods),
            )
        ],
        [f"figure-{number}"],
        watch.seconds,
    )


def _name(motion: paper.Shown, label: OrbitLabel) -> str:
    return f"{label} at frequency {motion.frequency:g}"


def _origin(attractor: ImpactAttractor) -> str:
    return (
        f"The motion is {attractor.label} after {attractor.transient} skipped impacts from the "
        "paper's start; time counts from the last of these."
    )


def _spectrum(attractor: ImpactAttractor) -> PowerSpectrum:
    """A spectrum up to the end of the paper's axis, of segments that hold whole periods."""
    periods = attractor.label.periods
    segments = _CHAOTIC_SEGMENTS if periods is None else _SEGMENTS
    frequency = attractor.system.frequency
    each = ceil(2.0 * paper.SPECTRUM_AXIS / frequency)
    length = each * (periods or 1) * max(1, round(_PERIODS / (periods or 1)))
    return PowerSpectrum(
        attractor,
        TWO_PI / (frequency * each),
        samples=length * (segments + 1) // 2,
        segments=segments,
    )


def _off(spectrum: PowerSpectrum, frequency: float) -> float:
    """Part of the power that is in no line at a multiple of the frequency."""
    at = spectrum.frequencies
    off = abs(at - frequency * np.rint(at / frequency)) > _LINE * at[1]
    return float(spectrum.density[off].sum() / spectrum.density.sum())


def _lines(
    motion: paper.Shown, label: OrbitLabel, spectrum: PowerSpectrum, lines: Harmonics
) -> _Found:
    frequency, periods, count = motion.frequency, label.periods or 1, label.harmonics or 0
    off = _off(spectrum, lines.frequency)
    strongest = np.argsort(lines.power)[::-1][: max(_LISTED, count)]
    shares = lines.power / lines.variance
    whole = shares[periods - 1 :: periods].sum()
    words = (
        f"All but {off:.0e} of the power is in lines at multiples of {frequency:g}/{periods}, "
        f"{100.0 * whole:.1f} % of it in harmonics of the table. Dots mark the lines as the "
        f"Fourier series of one period has them; {count} of them hold 99 % of the power. Their "
        f"amplitudes are good to {lines.error:.0e}."
    )
    both = lcm(periods, motion.periods or 1)
    if both != periods:
        others = off - _off(spectrum, frequency / both)
        words += (
            f" A motion of {motion.periods} table periods, the paper's reading, has other lines, "
            f"at multiples of {frequency:g}/{both}: {others:.0e} of the power is there."
        )
    rows = [
        [k + 1, f"{lines.frequencies[k]:.5f}", f"{100.0 * shares[k]:.3f} %"]
        for k in strongest.tolist()
    ]
    listed = table([f"multiple of {frequency:g}/{periods}", "frequency", "part of the power"], rows)
    return _Found(
        f"{words} The strongest:\n\n{listed}",
        f"lines at multiples of {frequency:g}/{periods}, {off:.0e} of the power off them; "
        f"{count} hold 99 %",
        f"{lines.error / float(abs(lines.coefficients).max()):.0e} of the largest",
    )


def _broad(attractor: ImpactAttractor, spectrum: PowerSpectrum) -> _Found:
    frequency, interval = attractor.system.frequency, spectrum.interval
    off = _off(spectrum, frequency)
    length = round(_PERIODS * TWO_PI / (frequency * interval))
    # quarters of two segments' length, three segments that overlap
    times = interval * np.arange(2.0 * length * _QUARTERS)
    parts = np.split(TimeSeries(attractor, times).values, _QUARTERS)
    shares = [_off(PowerSpectrum(part, interval, segments=3), frequency) for part in parts]
    error = float(np.std(shares, ddof=1)) / np.sqrt(_QUARTERS)
    words = (
        f"{100.0 * off:.0f} % of the power is in no harmonic of the table, give or take "
        f"{100.0 * error:.0f} % (from {_QUARTERS} parts of the motion); single densities have a "
        f"standard error of {100.0 * spectrum.error:.0f} %."
    )
    short = f"{100.0 * off:.0f} % of the power off the table's harmonics"
    return _Found(words, short, f"{100.0 * error:.0f} %")


def _draw_series(
    workshop: Workshop,
    number: int,
    motion: paper.Shown,
    attractor: ImpactAttractor,
    spectrum: PowerSpectrum,
) -> None:
    figure, (above, below) = new_figure(height=4.0, rows=2)
    times = np.linspace(0.0, motion.end, round(motion.end / _INTERVAL) + 1)
    TimeSeries(attractor, times).plot(above)
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, handlelength=1.8)
    spectrum.plot(below)
    below.set_xlim(0.0, paper.SPECTRUM_AXIS)
    highest = float(spectrum.density.max())
    below.set_ylim(highest * 10.0**-_DECADES, 5.0 * highest)
    save_figure(figure, workshop.folder / f"figure-{number}")


# --- sections -------------------------------------------------------------------------------------


def _sections(workshop: Workshop, number: int, motion: paper.Shown) -> Section:
    watch = Stopwatch()
    with watch.time("simulation"):
        attractor = workshop.shown(motion.frequency)
        label = attractor.label
        impacts, stroboscopic = ImpactSection(attractor), StroboscopicSection(attractor)
    with watch.time("error"):
        # in chaos from all over the motion: near a periodic one nothing parts for long
        places = attractor.states[:: -(len(attractor.states) // _PLACES)][:_PLACES]
        pairs = [_distances(attractor, each) for each in places[: 1 if label.periods else None]]
        error = "none: chaotic" if label.periods is None else f"{impacts.error:.0e}"
        early = None
        if None not in (label.periods, motion.periods) and motion.periods != label.periods:
            early = _early(workshop, motion)
    with watch.time("drawing"), print_style():
        figure, (above, below) = new_figure(height=4.6, rows=2)
        impacts.plot_velocity(above)
        if label.kind is OrbitKind.STICKING:
            _mark_contact(above, impacts)
        stroboscopic.plot(below)
        if early is not None:
            _mark_early(below, early)
        save_figure(figure, workshop.folder / f"figure-{number}")
    seen = _impacts_seen(attractor, impacts)
    points = f"{_distinct(_tip(stroboscopic))} points in {len(stroboscopic.states)} periods"
    parted = _parted(pairs)
    text = (
        f"{_origin(attractor)} Above: velocity of the tip just after {len(impacts.states)} impacts "
        "against the phase of the table, and the velocity of the table (dashed): the height above "
        "it is the relative velocity. Below: position and velocity of the tip whenever the phase "
        f"is zero, in {len(stroboscopic.states)} periods of the table.\n\n"
        f"Impacts: {seen}. Stroboscopic section: {points}. Two motions that begin "
        f"{pairs[0][0]:.1e} apart, {paper.DISTANCE:g} in every coordinate, are {parted}."
    )
    if early is not None:
        text += f"\n\n{about_early(motion, early, label.periods or 1)}"
    at = f"at {motion.frequency:g}"
    return Section(
        f"figure-{number}",
        f"Figure {number}: {_name(motion, label)} in its sections",
        text,
        [
            Finding(
                f"impact section {at}", motion.impacts, seen, error, _same(motion.impacts, seen)
            ),
            Finding(
                f"stroboscopic section {at}",
                motion.stroboscopic,
                points,
                error,
                _same(motion.stroboscopic, points),
            ),
            Finding(
                f"motions {paper.DISTANCE:g} apart {at}",
                motion.parting,
                parted,
                "none" if label.periods is None else f"{impacts.error:.0e}",
                None if motion.periods is None else label.periods is not None,
            ),
        ],
        [f"figure-{number}"],
        watch.seconds,
    )


def _same(theirs: str, found: str) -> bool | None:
    """Whether both say the same: the number of points, or the same words; None where one cannot."""
    number = theirs.partition(" ")[0]
    if number.isdigit():
        return found.partition(" ")[0] == number
    return True if theirs in found else None


def _distances(attractor: ImpactAttractor, state: Array) -> Array:
    """Distances of two motions, one from this state, at their start and after each impact."""
    system = attractor.system
    pair = [state, state + paper.DISTANCE]
    motions = [
        system.simulate(impacts=_FOLLOWED, start=system.impact_state(each)).states for each in pair
    ]
    gaps = system.difference(
        *(np.concatenate([s[None], m]) for s, m in zip(pair, motions, strict=True))
    )
    return np.asarray(np.linalg.norm(gaps, axis=1))


def _parted(pairs: list[Array]) -> str:
    """What became of the distances of two motions; from several places, of the one in between."""
    far = [np.flatnonzero(distances > FAR) for distances in pairs]
    order = np.argsort([found[0] if len(found) else _FOLLOWED + 1 for found in far])
    middle = int(order[len(order) // 2])
    of = f" (the median of {len(pairs)} places)" if len(pairs) > 1 else ""
    if len(far[middle]):
        return f"{FAR:g} apart after {far[middle][0]} impacts{of}"
    largest, last = float(pairs[middle].max()), float(pairs[middle][-1])
    return f"never farther apart than {largest:.0e}, and {last:.0e} after {_FOLLOWED} impacts{of}"


def _tip(section: StroboscopicSection) -> Array:
    """Positions and velocities of the last mass, (p, 2)."""
    return section.states[:, paper.MASSES - 1 :: paper.MASSES]


def _distinct(points: Array) -> int:
    """Number of points (p, 2) that differ."""
    near, count, left = _SAME * float(abs(points).max()), 0, points
    while len(left):
        left = left[np.linalg.norm(left - left[0], axis=1) > near]
        count += 1
    return count


def _impacts_seen(attractor: ImpactAttractor, section: ImpactSection) -> str:
    label, record = attractor.label, attractor.record
    if label.kind is not OrbitKind.STICKING or label.periods is None:
        points = np.stack([section.phase, section.relative_velocity], axis=1)
        count = _distinct(points)
        return f"{count} point{'s' if count > 1 else ''} in {len(record)} impacts"
    period = label.periods * TWO_PI / attractor.system.frequency
    count = int((record.time > record.time[-1] - period).sum())
    least = float(section.relative_velocity.min())
    return (
        f"{count} points that run up to the table's velocity, down to {least:.0e} above it, where "
        "contact begins"
    )


def _early(workshop: Workshop, motion: paper.Shown) -> Array:
    """The tip, (p, 2), as the paper's time axis has it when the paper stops to skip impacts."""
    attractor = workshop.chain(motion.frequency).attractor(
        transient=paper.TRANSIENT, impacts=paper.KEPT
    )
    periods = floor(motion.end * motion.frequency / TWO_PI)
    return _tip(StroboscopicSection(attractor, periods=periods))


def about_early(motion: paper.Shown, early: Array, periods: int) -> str:
    """Return what the paper's stroboscopic section shows, of a motion of so many table periods.

    Parameters
    ----------
    motion : paper.Shown
    early : (p, 2) array
        The tip at phase zero, before the motion has settled.
    periods : int
    """
    groups = [early[k::periods] for k in range(periods)]
    velocities = min(groups, key=lambda group: float(group[:, 0].mean()))[:, 1]
    listed = ", ".join(f"{velocity:.4f}" for velocity in velocities.tolist())
    every = {1: "each", 2: "every other one"}.get(periods, f"every {periods}th one")
    settled = float(np.ptp(velocities)) <= _SAME * float(abs(velocities).max())
    turns = _turns(velocities)
    return sentences(
        f"The paper reads {motion.stroboscopic}. It skips {paper.TRANSIENT} impacts: in the "
        f"{len(early)} table periods that its time axis shows next (open circles) the tip has, in "
        f"{every}, the velocities {listed}.",
        "They are the same: the motion has settled then."
        if settled
        else "The motion has not settled then.",
        f"The first {turns} of them rise and fall in turn, as those of a motion of "
        f"{2 * periods} table periods do."
        if turns > 2 and not settled
        else "",
    )


def _turns(values: Array) -> int:
    """How many of the first values rise and fall in turn."""
    signs = np.sign(np.diff(values))
    same = np.flatnonzero(signs[1:] * signs[:-1] >= 0.0)
    return len(values) if not len(same) else int(same[0]) + 2


def _mark_early(axes: Axes, early: Array) -> None:
    """Draw states that have not settled, as open circles."""
    axes.lines[0].set_label("settled")
    circles = {**DOTS, "color": "none", "markeredgecolor": "black", "markeredgewidth": 0.5}
    name = f"after {paper.TRANSIENT} impacts"
    axes.plot(early[:, 0], early[:, 1], markersize=4.5, label=name, **circles)
    axes.legend(loc="upper center")


def _mark_contact(axes: Axes, impacts: ImpactSection) -> None:
    """Point at where the impacts accumulate."""
    last = int(np.argmin(impacts.relative_velocity))
    phase, velocity = np.asarray(axes.lines[0].get_xydata())[last].tolist()
    axes.annotate(
        "sticking event",
        (phase, velocity),
        xytext=(24.0, 6.0),
        textcoords="offset points",
        fontsize=7.0,
        arrowprops={"arrowstyle": "-|>", "linewidth": 0.6, "color": "black", "shrinkB": 3.0},
    )
