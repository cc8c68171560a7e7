"""Bad input of the `dynkit` command: exit code 2, one line on stderr, and nothing written."""

import re
from pathlib import Path

import pytest

from dynkit.cli import main
from dynkit.systems import ImpactChain

SWEEP = "sweep --from 0.86 --to 0.88 --step 0.01 --no-progress"
CONTINUE = "continue --frequency 0.87 --from 0.7 --to 1.1"
MAP = "map --masses 2 --keep 40 --no-progress --x frequency,0.5,0.9,3 --y damping,0.1,0.2,2"

NAMES = "must be one of: frequency, restitution, amplitude, offset, play, springs, damping"
ENDINGS = "out must end in .csv, .npz, .h5, .png, .svg, .pdf"

# What is typed, and what is said.
BAD_INPUT = [
    ("simulate", "frequency must be given"),
    ("simulate --frequency 0.9 --restitution 1.2", "restitution must lie in [0, 1]; got 1.2"),
    ("simulate --frequency 0", "frequency must be positive; got 0"),
    ("simulate --frequency nan", "frequency must be a finite number; got nan"),
    ("simulate --frequency fast", "frequency must be a finite number; got 'fast'"),
    ("simulate --frequency 1 --damping -0.1", "damping must not be negative; got -0.1"),
    ("simulate --frequency 1 --masses 1,0,1", "masses[1] must be positive; got 0.0"),
    ("simulate --frequency 1 --masses 2.5", "masses must be a positive integer; got 2.5"),
    (
        "simulate --frequency 1 --masses 2 --position=0,-1",
        "position[1] must not be below the table at 0.0; got -1.0",
    ),
    ("simulate --frequency 1 --impacts many", "impacts must be a positive integer; got 'many'"),
    (
        "simulate --frequency 1 --observable speed",
        (
            "observable must be one of: time, phase, relative_velocity, energy, "
            "position, velocity; got 'speed'"
        ),
    ),
    (
        "simulate --frequency 1 --out motion.gif",
        f"{ENDINGS}; got 'motion.gif'",
    ),
    (
        "simulate --frequency 1 --out missing/motion.csv",
        "out must be writable; got 'missing/motion.csv' (No such file or directory)",
    ),
    ("simulate missing.toml", "missing.toml cannot be read: No such file or directory"),
    ("simulate --frequncy 1", "there is no argument --frequncy"),
    ("sweep", "from must be given, or values"),
    ("sweep --values 0.5,nan", "values[1] must be a finite number; got nan"),
    ("sweep --values 0.5,0", "frequency must be positive; got 0.0 in values[1]"),
    ("sweep --from 1 --to 2 --step -0.1", "step must lead from 1.0 to 2.0; got -0.1"),
    ("sweep --from 1 --to 2 --step 0", "step must lead from 1.0 to 2.0; got 0.0"),
    ("sweep --from 1 --to 2 --step 1e-9", "step must not give more than 1000000 values; got 1e-09"),
    ("sweep --from 1 --values 1,2", "from must not be given together with values; got 1"),
    ("sweep --values 1 --frequency 1", "frequency must not be given when it is swept; got 1"),
    (
        "sweep --values 1 --parameter masses",
        f"parameter {NAMES}; got 'masses'",
    ),
    ("sweep --values 1 --parameter restitution", "frequency must be given"),
    ("sweep --values 1 --keep 0", "keep must be a positive integer; got 0"),
    (
        "sweep --values 1 --store missing/sweep.h5",
        "store must be writable; got 'missing/sweep.h5' (No such file or directory)",
    ),
    ("sweep --values 1 --store a.h5 --out a.h5", "out must be another file than store; got 'a.h5'"),
    ("simulate --frequency 1 --side left", "side must be one of: above, below; got 'left'"),
    (
        "simulate --frequency 1 --masses 2 --harmonic_forces 1j",
        "harmonic_forces must have shape (2,); got shape (1,)",
    ),
    (
        "simulate --frequency 1 --masses 3 --velocity 0,1",
        "velocity must have shape (3,); got shape (2,)",
    ),
    (
        "simulate --frequency 1 --transient -1",
        "transient must be zero or a positive integer; got -1",
    ),
    (
        "simulate a.toml --config b.toml",
        "config must not be given together with a file; got 'b.toml'",
    ),
    (
        "sweep --values 1 --no-labels=3",
        "argument --labels/--no-labels: ignored explicit argument '3'",
    ),
    ("continue --frequency 1", "from must be given"),
    (f"{CONTINUE} --step 0", "step must be positive; got 0"),
    (f"{CONTINUE} --store a.h5 --out a.h5", "out must be another file than store; got 'a.h5'"),
    ("work-precision", "frequency must be given"),
    (
        "work-precision --frequency 1 --methods dynkit,RK54",
        "methods must be one of: dynkit, RK45, DOP853, Radau, LSODA; got 'RK54'",
    ),
    ("work-precision --frequency 1 --impacts 0", "impacts must be a positive integer; got 0"),
    (
        "work-precision --frequency 1 --out table.txt",
        "out must end in .csv, .npz, .h5, .png, .svg, .pdf; got 'table.txt'",
    ),
    (
        "work-precision --config missing.toml",
        "missing.toml cannot be read: No such file or directory",
    ),
    ("continue --from 0.7 --to 1", "frequency must be given"),
    (
        f"{CONTINUE} --parameter masses",
        f"parameter {NAMES}; got 'masses'",
    ),
    ("continue --frequency 0.87 --from 1 --to 0.7", "to must be greater than from; got 0.7"),
    ("continue --frequency 0.87 --from 0.9 --to 1.1", "frequency must lie in [0.9, 1.1]; got 0.87"),
    (f"{CONTINUE} --impacts 0", "impacts must be a positive integer; got 0"),
    (
        f"{CONTINUE} --periods 3 --transient 10",
        "transient must not be given together with impacts or periods; got 10",
    ),
    (
        f"{CONTINUE} --out branch.jpg",
        f"{ENDINGS}; got 'branch.jpg'",
    ),
    (
        f"{CONTINUE} --store missing/branch.h5",
        "store must be writable; got 'missing/branch.h5' (No such file or directory)",
    ),
    (
        "continue --frequency 1.346 --from 1.3 --to 1.4",
        (
            "impacts and periods must be given where the motion is not P(n,m) "
            "or P(inf,m); at frequency 1.346 it is chaotic"
        ),
    ),
    (
        f"{MAP} --x speed,1,2,3",
        f"x {NAMES}; got 'speed'",
    ),
    (f"{MAP} --x frequency,1,2", "x must be NAME,FROM,TO,COUNT; got ['frequency', 1, 2]"),
    (f"{MAP} --x 1,2,3,4", "x must be NAME,FROM,TO,COUNT; got [1, 2, 3, 4]"),
    (f"{MAP} --x frequency,1,two,4", "x must be a finite number; got 'two'"),
    (f"{MAP} --x frequency,1,2,2.5", "COUNT of x must be a positive integer; got 2.5"),
    (
        f"{MAP} --y frequency,1,2,3",
        "y must be of another parameter than x; got ['frequency', 1, 2, 3]",
    ),
    (f"{MAP} --damping 0.1", "damping must not be given when it changes; got 0.1"),
    (f"{MAP} --workers 0", "workers must be a positive integer; got 0"),
    (f"{MAP} --out map.gif", f"{ENDINGS}; got 'map.gif'"),
    (f"{MAP} --store a.h5 --out a.h5", "out must be another file than store; got 'a.h5'"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("typed", "line"), BAD_INPUT)
def test_bad_input_is_refused_on_one_line_and_nothing_is_written(
    typed: str, line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(typed.split()) == 2
    printed = capsys.readouterr()
    assert printed.err == f"dynkit {typed.split(maxsplit=1)[0]}: error: {line}\n"
    assert printed.out == ""
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("arguments", [[], ["simulat"], ["simulate", "a.toml", "b.toml"]])
def test_what_is_no_command_is_refused_on_one_line(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert re.fullmatch(r"dynkit( simulate)?: error: .*(COMMAND|'simulat'|b\.toml).*\n", error)


def test_unknown_key_in_a_file_is_refused_by_name(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "motion.toml").write_text("frequency = 0.87\nrestitutoin = 0.8\n")
    assert main(["simulate", "motion.toml"]) == 2
    error = capsys.readouterr().err
    assert re.fullmatch(r"dynkit simulate: error: motion.toml .* got 'restitutoin'\n", error)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("frequency = ", "motion.toml must be a TOML file"),
        ("frequency = '0.87'", "frequency must be a finite number; got '0.87'"),
        ("frequency = true", "frequency must be a finite number; got True"),
        ("frequency = 0.87\nout = 5", "out must be a name; got 5"),
        ("frequency = 0.87\nside = 1", "side must be a name; got 1"),
        ("frequency = 0.87\nobservable = []", r"observable must be one or more names; got \[\]"),
    ],
)
def test_bad_file_is_refused(
    text: str, line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "motion.toml").write_text(text)
    assert main(["simulate", "motion.toml"]) == 2
    assert re.match(f"dynkit simulate: error: {line}", capsys.readouterr().err)


def test_output_that_cannot_be_written_is_refused_before_simulating(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(ImpactChain, "attractor", never)
    (folder / "motion.csv").mkdir()
    assert main(["simulate", "--frequency", "1", "--out", "motion.csv"]) == 2
    assert "out must be a file; got the folder 'motion.csv'" in capsys.readouterr().err


def test_store_of_another_sweep_is_refused_and_kept(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*SWEEP.split(), "--store", "sweep.h5"]) == 0
    before = (folder / "sweep.h5").read_bytes()
    assert main([*SWEEP.split(), "--store", "sweep.h5", "--damping", "0.2"]) == 2
    assert "damping 0.1; got 0.2" in capsys.readouterr().err
    assert (folder / "sweep.h5").read_bytes() == before
