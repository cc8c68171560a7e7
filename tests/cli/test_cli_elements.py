"""Elements of a machine in the file of a command."""

from pathlib import Path

import numpy as np
import pytest

from dynkit.cli import main
from dynkit.systems import DryFriction, HardStop, ImpactChain, SoftStop

MACHINE = """
masses = 2
frequency = 0.9
harmonic_forces = [0.0, 0.5]

[[elements]]
kind = "HardStop"
coordinate = 1
offset = -0.2
restitution = 0.7

[[elements]]
kind = "DryFriction"
coordinate = [0, 1]
force = 0.05
name = "joint"
"""
CHAIN = ImpactChain(
    masses=2,
    frequency=0.9,
    harmonic_forces=[0.0, 0.5],
    elements=[
        HardStop(1, offset=-0.2, restitution=0.7),
        DryFriction((0, 1), force=0.05, name="joint"),
    ],
)


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "machine.toml").write_text(MACHINE)
    return tmp_path / "machine.toml"


def test_a_file_describes_elements(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "machine.toml"]) == 0
    label = CHAIN.attractor().label
    assert f"label              {label} " in capsys.readouterr().out


def test_complex_forces_are_texts_of_a_file_and_states_are_a_table(file: Path) -> None:
    soft = MACHINE.replace("HardStop", "SoftStop").replace("restitution = 0.7", "stiffness = 9")
    file.write_text(soft.replace("[0.0, 0.5]", '[0.0, "0.5+0.2j"]'))
    run = ["simulate", "machine.toml", "--impacts", "4", "--observable", "time,position"]
    assert main([*run, "--out", "motion.csv"]) == 0
    assert main([*run, "--out", "motion.npz"]) == 0
    assert len(Path("motion.csv").read_text().splitlines()) == 1 + 4 * 2  # of two masses
    elements = [
        SoftStop(1, offset=-0.2, stiffness=9.0),
        DryFriction((0, 1), force=0.05, name="joint"),
    ]
    machine = CHAIN.replace(elements=elements, harmonic_forces=[0.0, 0.5 + 0.2j])
    kept = machine.attractor(impacts=4).record
    with np.load("motion.npz") as found:
        assert np.array_equal(found["position"], kept.position)


def test_their_numbers_are_swept_and_mapped(capsys: pytest.CaptureFixture[str]) -> None:
    values = ["--parameter", "joint.force", "--values", "0.05,0.06", "--keep", "20"]
    assert main(["sweep", "machine.toml", *values]) == 0
    assert "joint.force        0.05 to 0.06, 2 values" in capsys.readouterr().out
    axes = ["--x", "joint.force,0.05,0.06,2", "--y", "elements[0].restitution,0.6,0.7,2"]
    assert main(["map", "machine.toml", *axes, "--keep", "20"]) == 0
    assert "elements[0].restitution" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["elements[0].restitution", "restitution"])
def test_a_file_describes_an_impact_law(
    name: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = 'restitution = { kind = "PlasticBelow", velocity = 0.02, rebound = 0.7 }'
    table = MACHINE.partition("[[elements]]")[0] + law
    machine = MACHINE.replace("restitution = 0.7", law)
    file.write_text(table if name == "restitution" else machine)
    assert main(["simulate", "machine.toml"]) == 0
    capsys.readouterr()
    values = ["--parameter", f"{name}.velocity", "--values", "0.02,0.1", "--keep", "20"]
    assert main(["sweep", "machine.toml", *values]) == 0
    assert f"{name}.velocity" in capsys.readouterr().out


def test_an_orbit_of_the_machine_is_followed(capsys: pytest.CaptureFixture[str]) -> None:
    bounds = ["--parameter", "joint.force", "--from", "0.049", "--to", "0.051"]
    assert main(["continue", "machine.toml", *bounds]) == 0
    shown = capsys.readouterr().out
    assert "stable" in shown
    orbit = CHAIN.attractor().periodic_orbit()
    assert f"started from  {orbit.label}, stable" in shown


def test_an_orbit_that_is_not_found_takes_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    bounds = ["--from", "0.85", "--to", "0.95", "--impacts", "3"]
    assert main(["continue", "machine.toml", *bounds]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("dynkit continue: error: no orbit P(3,1) was found for ImpactChain(")
    assert shown.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("elements = 3", "elements must be tables [[elements]]; got 3"),
        ("elements = [3]", "elements[0] must be a table with a kind; got 3"),
        ("elements = []", "elements must be tables [[elements]]; got []"),
        ('[elements]\nkind = "HardStop"', "elements must be tables [[elements]]; got {"),
        ('[[elements]]\nkind = "Stop"', "elements[0].kind must be one of: HardStop, SoftStop"),
        ("[[elements]]\ncoordinate = 0", "elements[0].kind must be one of"),
        ('[[elements]]\nkind = "HardStop"', "elements[0].coordinate must be given"),
        ('[[elements]]\nkind = "SoftStop"\ncoordinate = 0', "elements[0].stiffness must be given"),
        ('[[elements]]\nkind = "HardStop"\ncoordinate = 7', "elements[0].coordinate must lie in"),
        (
            '[[elements]]\nkind = "HardStop"\ncoordinate = 0\nrestitution = 2',
            "elements[0]: restitution must lie in [0, 1]; got 2",
        ),
        ('restitution = { kind = "Soft" }', "restitution.kind must be one of: PlasticBelow, Visco"),
        ('restitution = { kind = "PlasticBelow" }', "restitution.velocity must be given"),
        (
            'restitution = { kind = "PlasticBelow", velocity = -1 }',
            "restitution: velocity must not be negative; got -1",
        ),
        (
            '[[elements]]\nkind = "DryFriction"\ncoordinate = 0\nforce = 1\nmass = 2',
            "a key of elements[0] must be one of: coordinate, offset",
        ),
    ],
)
def test_elements_that_are_none_are_refused(
    file: Path, text: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(f"masses = 2\nfrequency = 0.9\n{text}\n")
    assert main(["simulate", "machine.toml"]) == 2
    shown = capsys.readouterr().err
    assert message in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize(
    ("run", "options"),
    [
        ("sweep", ["--values", "0.8,0.9"]),
        ("map", ["--x", "frequency,0.8,0.9,2", "--y", "joint.force,0.05,0.1,2", "--keep", "20"]),
    ],
)
def test_the_value_of_a_parameter_that_changes_has_no_effect_in_a_file(
    run: str, options: list[str], file: Path
) -> None:
    written = []
    for text in (MACHINE, MACHINE.replace("frequency = 0.9", "frequency = 0.5")):
        file.write_text(text)
        assert main([run, "machine.toml", *options, "--no-progress", "--out", "x.csv"]) == 0
        written.append(Path("x.csv").read_bytes())
    assert written[0] == written[1]
    assert main([run, "machine.toml", *options, "--frequency", "0.5"]) == 2
