"""Sketches of machines show every element, on its side, by its name, and nothing overlaps."""

from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from dynkit.systems import (
    BouncingBall,
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactOscillator,
    MatrixOscillator,
    PlayOscillator,
    SoftStop,
)

MACHINES: dict[str, ImpactOscillator] = {
    "chain": ImpactChain(frequency=0.9),
    "ball": BouncingBall(frequency=1.0, amplitude=2.0, restitution=0.5),
    "play": PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5),
    "twenty": ImpactChain(masses=20, frequency=0.9),
    "brake": ImpactChain(
        masses=3,
        frequency=0.4,
        elements=[
            HardStop(2, amplitude=0.3, restitution=0.4, name="table"),
            HardStop((0, 1), offset=-0.02, restitution=0.5),
            SoftStop(1, offset=0.1, stiffness=20.0, damping=0.2, name="pad"),
            DryFriction(0, force=0.05, static=0.08, velocity=0.02, name="belt"),
        ],
    ),
    "frame": MatrixOscillator(
        M=np.eye(4),
        C=0.05 * np.eye(4),
        K=[[3, -1, -1, 0], [-1, 2, -1, 0], [-1, -1, 4, -1], [0, 0, -1, 1]],
        frequency=1.0,
        elements=[
            HardStop(3, side="below", offset=0.3),
            SoftStop((0, 2), stiffness=3.0, name="far_pad"),
            DryFriction((1, 2), force=0.1, name="pads"),
            DryFriction((0, 3), force=0.1),
            HardStop([1.0, 1.0, 1.0, 0.0], offset=-2.0),
            SoftStop(3, offset=-1.0, stiffness=1.0, name="a_pad_with_a_long_name"),
        ],
    ),
}


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    pyplot.close("all")


def texts(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts if text.get_text()]


@pytest.mark.parametrize("name", MACHINES)
def test_names_are_all_there_apart_and_inside(name: str) -> None:
    machine = MACHINES[name]
    ax = machine.plot()
    ax.figure.draw_without_rendering()  # type: ignore[union-attr]
    shown = texts(ax)
    elements = [
        e.name.replace("_", " ") or f"elements[{k}]" for k, e in enumerate(machine.elements)
    ]
    assert set(elements or ["table"]) <= set(shown)
    assert len(shown) == machine.degrees_of_freedom + max(len(elements), 1 + (name == "play"))
    boxes = [text.get_window_extent() for text in ax.texts if text.get_text()]
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
    whole = ax.figure.bbox
    assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 for box in boxes)
    assert all(whole.y0 <= box.y0 and box.y1 <= whole.y1 for box in boxes)


@pytest.mark.parametrize(("side", "sign"), [("above", -1.0), ("below", 1.0)])
def test_a_stop_is_on_the_side_that_it_is_hit_from(side: str, sign: float) -> None:
    ball = MatrixOscillator(
        M=[[1.0]], C=[[0.0]], K=[[0.0]], frequency=1.0, elements=[HardStop(0, side=side)]
    )
    walls = [p for p in ball.plot().patches if isinstance(p, Rectangle) and p.get_hatch()]
    assert [np.sign(wall.get_x() + 0.5 * wall.get_width()) for wall in walls] == [sign]


@pytest.mark.parametrize("along", [(0, 1), (1, 0)])
@pytest.mark.parametrize("side", ["above", "below"])
def test_what_keeps_masses_from_moving_apart_is_a_cage(along: tuple[int, int], side: str) -> None:
    pair = MatrixOscillator(
        M=np.eye(2),
        C=np.zeros((2, 2)),
        K=np.eye(2),
        frequency=1.0,
        elements=[HardStop(along, offset=-1.0 if side == "above" else 1.0, side=side)],
    )
    halves = [line for line in pair.plot().get_lines() if len(np.asarray(line.get_xdata())) == 4]
    apart = (along == (0, 1)) == (side == "below")
    assert len(halves) == (2 if apart else 0)


def test_springs_are_those_of_the_matrix() -> None:
    bare = MatrixOscillator(M=np.eye(3), C=np.zeros((3, 3)), K=np.zeros((3, 3)), frequency=1.0)
    counts = []
    for entries in ([], [(0, 1)], [(0, 1), (0, 2)]):
        matrix = np.zeros((3, 3))
        for i, j in entries:
            matrix[[i, j], [i, j]] += 1.0
            matrix[[i, j], [j, i]] -= 1.0
        lines = bare.replace(K=matrix).plot().get_lines()
        counts.append(sum(len(np.asarray(line.get_xdata())) == 10 for line in lines))
    assert counts == [0, 1, 2]


def test_it_is_drawn_where_one_wants_it_and_large_ones_are_refused() -> None:
    ax = MACHINES["brake"].plot()
    again = MACHINES["chain"].plot(ax)
    assert again is ax
    with pytest.raises(
        ValueError, match="degrees_of_freedom must not exceed 20 in a sketch; got 21"
    ):
        ImpactChain(masses=21, frequency=0.9).plot()
