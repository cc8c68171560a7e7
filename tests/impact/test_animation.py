"""Animations show the machine as it moves: masses, gaps, impacts, sticking."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dynkit.plotting.figures import new_figure
from dynkit.systems import DryFriction, HardStop, ImpactChain, ImpactRecord, SoftStop
from dynkit.systems.impact.records.animation import poses_at
from dynkit.systems.impact.records.sketch import sketch

MACHINE = ImpactChain(
    masses=3,
    frequency=0.4,
    elements=[
        HardStop(2, amplitude=0.3, restitution=0.4, name="table"),
        HardStop((0, 1), offset=-0.02, restitution=0.5),
        SoftStop(1, offset=0.1, stiffness=20.0, damping=0.2, name="pad"),
        DryFriction(0, force=0.05, static=0.08, velocity=0.02, name="belt"),
    ],
)


@pytest.fixture(scope="module")
def record() -> ImpactRecord:
    return MACHINE.simulate(impacts=60)


def test_displacements_and_gaps_have_one_scale(record: ImpactRecord) -> None:
    times = np.linspace(250.0, 300.0, 7)
    poses = poses_at(record, times)
    x, _ = record.sample(times)
    scale = poses[0].shift[2] / x[0, 2]
    assert scale > 0.0
    np.testing.assert_allclose([pose.shift for pose in poses], scale * x, rtol=1e-12)
    for name in ("table", "elements[1]", "pad"):
        gaps = scale * record.observable(f"{name}.gap", times)
        np.testing.assert_allclose([pose.gaps[name] for pose in poses], gaps, rtol=1e-12)


def test_masses_do_not_overlap(record: ImpactRecord) -> None:
    poses = poses_at(record, np.linspace(0.0, record.time[-1], 500))
    assert max(float(abs(np.diff(pose.shift)).max()) for pose in poses) < 1.6


def test_a_stop_is_marked_from_its_impact_on_for_some_frames(record: ImpactRecord) -> None:
    hits = record.time[record.element == 0]
    alone = 1 + int(np.argmax(np.minimum(np.diff(hits)[:-1], np.diff(hits)[1:])))
    poses = poses_at(record, hits[alone] + np.linspace(-0.2, 0.2, 41))
    struck = [pose.struck.get("table", 0.0) for pose in poses]
    assert struck[:20] == [0.0] * 20
    assert struck[20] == 1.0
    assert np.all(np.diff(struck[20:25]) < 0.0)
    assert struck[25:] == [0.0] * 16
    assert abs(poses[20].gaps["table"]) < 1e-12


def test_friction_that_sticks_is_named(record: ImpactRecord) -> None:
    times = np.linspace(200.0, 300.0, 101)
    stuck = ["belt" in pose.stuck for pose in poses_at(record, times)]
    sticks = record.observable("belt.slip_velocity", times) == 0.0
    assert sticks.sum() > 0
    assert stuck == sticks.tolist()


def test_names_stay_apart_from_all_else_in_a_row_of_their_own(record: ImpactRecord) -> None:
    for pose in poses_at(record, np.linspace(250.0, 300.0, 5)):
        figure, (ax,) = new_figure()
        sketch(ax, MACHINE, pose)
        figure.draw_without_rendering()
        names = [text for text in ax.texts if text.get_text() in {"table", "pad", "belt"}]
        assert len(names) == 3
        assert len({text.get_position()[1] for text in names}) == 3
        rightmost = max(line.get_xdata().max() for line in ax.lines)  # type: ignore[union-attr]
        assert all(text.get_position()[0] > rightmost for text in names)


def test_a_film_is_saved_frame_by_frame(record: ImpactRecord, tmp_path: Path) -> None:
    film = record.animate(begin=290.0, end=295.0, frames=4)
    film.save(tmp_path / "film.gif", writer="pillow")
    with Image.open(tmp_path / "film.gif") as saved:
        assert saved.n_frames == 4  # type: ignore[attr-defined]


def test_a_notebook_shows_it_with_controls(record: ImpactRecord) -> None:
    html = record.animate(begin=294.0, end=295.0, frames=2)._repr_html_()
    assert "<input" in html


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frames": 0}, r"frames must be a positive integer; got 0"),
        ({"begin": 3.0, "end": 2.0}, r"begin must lie in \[0.0, 2.0\]; got 3.0"),
        ({"end": 1e9}, r"end must lie in \[0.0, 3.*\]; got 1000000000.0"),
        ({"element": "bolt"}, r"element must be one of"),
    ],
)
def test_wrong_arguments_are_refused(
    record: ImpactRecord, given: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        record.animate(**given)  # type: ignore[arg-type]


def test_too_many_masses_are_refused() -> None:
    long = ImpactChain(masses=21, frequency=0.9).simulate(impacts=2)
    with pytest.raises(
        ValueError, match="degrees_of_freedom must not exceed 20 in a sketch; got 21"
    ):
        long.animate(frames=2)


def test_an_orbit_moves_through_one_period() -> None:
    orbit = ImpactChain(masses=3, frequency=0.8).periodic_orbit()
    film = orbit.animate(frames=2)
    assert "<input" in film.to_jshtml()
    below = film._fig.axes[1]  # type: ignore[attr-defined]
    assert below.lines[0].get_xdata()[[0, -1]] == pytest.approx([0.0, orbit.period])
    np.testing.assert_allclose(below.lines[0].get_ydata()[[0, -1]], orbit.sample([0, 0])[0][:, -1])


def test_an_orbit_that_is_no_motion_does_not_move() -> None:
    orbit = ImpactChain(masses=3, frequency=0.8).periodic_orbit(periods=2)
    with pytest.raises(ValueError, match=r"^orbit must be admissible, a motion .*inadmissible"):
        orbit.animate()
