"""The `dynkit` command: exit codes, messages, files, help."""

import csv
import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dynkit import __version__, sweep
from dynkit.cli import COMMANDS, main, simulate
from dynkit.cli.options import values_of
from dynkit.systems import ImpactChain

SWEEP = ["sweep", "--from", "0.86", "--to", "0.88", "--step", "0.01", "--no-progress"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows_of(path: Path) -> list[list[str]]:
    with path.open(newline="") as stream:
        return list(csv.reader(stream))


def hdf5_of(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and attributes of a file."""
    with h5py.File(path) as file:
        found: Any = file  # h5py's own types know no more than that it holds something
        return {name: found[name][()] for name in found}, dict(found.attrs)


def described(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main([*arguments, "--help"]) == 0
    return capsys.readouterr().out


# --- exit codes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raised", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "dynkit simulate: interrupted\n"),
        (OSError("disk full"), 1, "dynkit simulate: failed: disk full\n"),
        (MemoryError(), 1, "dynkit simulate: failed: MemoryError\n"),
    ],
)
def test_run_that_ends_badly_says_so_by_its_exit_code(
    raised: BaseException,
    code: int,
    line: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise raised

    monkeypatch.setattr(ImpactChain, "attractor", fail)
    assert main(["simulate", "--frequency", "1", "--out", "motion.csv"]) == code
    assert capsys.readouterr().err == line
    assert list(folder.iterdir()) == []


def test_write_that_fails_leaves_the_old_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full:
        def writerow(self, _: object) -> None:
            raise OSError("disk full")

    (folder / "motion.csv").write_text("old")
    monkeypatch.setattr(csv, "writer", lambda *_, **__: Full())
    assert main(["simulate", "--frequency", "1", "--out", "motion.csv"]) == 1
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("motion.csv", "old")]


def test_module_runs_as_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dynkit", "--version"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"dynkit {__version__}\n"


# --- help -----------------------------------------------------------------------------------------


def toml_files_of(text: str) -> dict[str, str]:
    """Files that a help text shows: ``name.toml may hold:`` and indented lines."""
    found = re.findall(r"^(\S+\.toml) may hold:\n((?:  .*\n?)+)", text, flags=re.MULTILINE)
    return dict(found)


def examples_of(text: str) -> list[list[str]]:
    return [line.split()[1:] for line in re.findall(r"^  (dynkit .*)$", text, flags=re.MULTILINE)]


def test_the_help_imports_no_library_of_numbers() -> None:
    code = (
        "import sys; from dynkit.cli import main; main(['--help']); "
        "sys.exit(bool({'numpy', 'numba', 'scipy', 'matplotlib'} & {*sys.modules}))"
    )
    subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.DEVNULL,
        check=True,
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_a_terminal_of_80_columns(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text, _, examples = described([command], capsys).partition("For instance:")
    assert max(map(len, text.splitlines())) <= 80
    assert examples


def test_every_field_of_the_chain_is_an_option_with_a_help() -> None:
    fields = [field.name for field in dataclasses.fields(ImpactChain) if field.init]
    fields.remove("elements")  # objects, not numbers
    texts = {option.name: option.help for option in simulate.OPTIONS}
    assert [name for name in fields if len(texts.get(name, "")) < 10] == []


@pytest.mark.parametrize("command", ["simulate", "sweep", "continue"])
def test_examples_of_the_help_run(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = described([command], capsys)
    for name, lines in toml_files_of(text).items():
        (folder / name).write_text("\n".join(map(str.strip, lines.splitlines())))
    examples = examples_of(text)
    assert examples
    for arguments in examples:
        assert main(arguments) == 0, arguments
        for option in ("--out", "--store"):
            if option in arguments:
                assert (folder / arguments[arguments.index(option) + 1]).exists()


@pytest.mark.parametrize("command", ["simulate", "sweep", "continue"])
def test_help_shows_a_file(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert toml_files_of(described([command], capsys))


def test_examples_of_the_main_help_are_complete(capsys: pytest.CaptureFixture[str]) -> None:
    commands = [arguments[0] for arguments in examples_of(described([], capsys))]
    assert commands[:3] == ["simulate", "sweep", "continue"]


# --- options and files ----------------------------------------------------------------------------


def test_file_and_options_give_the_same_bits(folder: Path) -> None:
    (folder / "motion.toml").write_text(
        "masses = [1, 1, 2]\nsprings = 1\n"
        'frequency = 0.9\nimpacts = 20\nobservable = ["time", "energy"]\nout = "a.csv"\n'
    )
    assert main(["simulate", "motion.toml"]) == 0
    options = "--masses 1,1,2 --springs 1 --frequency 0.9 --impacts 20 --observable time,energy"
    assert main(["simulate", *options.split(), "--out", "b.csv"]) == 0
    assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()


def test_options_go_before_the_file(folder: Path) -> None:
    (folder / "motion.toml").write_text('frequency = 0.5\nimpacts = 20\nout = "a.csv"\n')
    assert main(["simulate", "motion.toml", "--frequency", "0.9"]) == 0
    assert main(["simulate", "--frequency", "0.9", "--impacts", "20", "--out", "b.csv"]) == 0
    assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()


def test_values_given_replace_the_range_of_the_file(folder: Path) -> None:
    (folder / "sweep.toml").write_text("from = 0.1\nto = 0.9\nstep = 0.01\nlabels = false\n")
    assert main(["sweep", "sweep.toml", "--values", "0.9", "--out", "a.csv", "--keep", "5"]) == 0
    assert {row[0] for row in rows_of(folder / "a.csv")[1:]} == {"0.9"}


@pytest.mark.parametrize(
    ("first", "last", "step", "values"),
    [
        (0.14, 2.0, 0.002, 931),
        (0.36, 0.44, 2e-4, 401),
        (1.0, 0.0, -0.25, 5),
        (0.5, 0.5, 1.0, 1),
        (0.0, 1.0, 0.3, 4),
    ],
)
def test_range_includes_its_last_value_when_a_step_meets_it(
    first: float, last: float, step: float, values: int
) -> None:
    found = values_of({"from": first, "to": last, "step": step})
    assert (len(found), found[0]) == (values, first)
    assert abs(found[-1] - last) < abs(step) * (1.0 - 1e-9)


def test_range_of_short_decimals_is_as_printed() -> None:
    assert values_of({"from": 0.14, "to": 0.146, "step": 0.002}).tolist() == [
        0.14, 0.142, 0.144, 0.146,
    ]  # fmt: skip


# --- results --------------------------------------------------------------------------------------


def test_simulate_writes_what_the_chain_simulates(folder: Path) -> None:
    assert main(["simulate", "--frequency", "0.87", "--impacts", "7", "--out", "motion.csv"]) == 0
    record = ImpactChain(frequency=0.87).attractor(impacts=7).record
    head, *rows = rows_of(folder / "motion.csv")
    assert head == ["time", "relative_velocity", "phase", "energy"]
    written = np.array(rows, dtype=float)
    assert np.array_equal(written[:, 1], record.relative_velocity)
    assert np.array_equal(written[:, 0], record.time)


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_simulate_writes_arrays(ending: str, folder: Path) -> None:
    arguments = "simulate --frequency 0.87 --impacts 7 --observable position,energy --out"
    assert main([*arguments.split(), f"motion.{ending}"]) == 0
    record = ImpactChain(frequency=0.87).attractor(impacts=7).record
    if ending == "npz":
        with np.load(folder / "motion.npz") as file:
            position, frequency = file["position"], float(file["parameter_frequency"])
    else:
        arrays, parameters = hdf5_of(folder / "motion.h5")
        position, frequency = arrays["position"], parameters["parameter_frequency"]
    assert np.array_equal(position, record.position)
    assert frequency == 0.87


def test_sweep_writes_what_sweep_finds(folder: Path) -> None:
    assert main([*SWEEP, "--keep", "9", "--out", "sweep.csv"]) == 0
    found = sweep(
        ImpactChain(frequency=0.86), "frequency", [0.86, 0.87, 0.88], keep=9, progress=False
    )
    head, *rows = rows_of(folder / "sweep.csv")
    assert head == [
        *("frequency", "state", "relative_velocity", "count", "ending", "displaced", "label"),
    ]
    velocity = np.array([row[2] for row in rows], dtype=float)
    assert np.array_equal(velocity, found.observable("relative_velocity").ravel())
    assert {row[-1] for row in rows} == {"P(1,3)"}


def test_sweep_writes_arrays_with_labels(folder: Path) -> None:
    assert main([*SWEEP, "--keep", "9", "--out", "sweep.h5"]) == 0
    arrays, parameters = hdf5_of(folder / "sweep.h5")
    assert arrays["relative_velocity"].shape == (3, 9)
    assert arrays["label"].tolist() == [b"P(1,3)"] * 3
    assert arrays["frequency"].tolist() == [0.86, 0.87, 0.88]
    assert (parameters["keep"], parameters["parameter_restitution"]) == (9.0, 0.85)


def test_sweep_tells_the_error_of_each_value(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*SWEEP, "--error", "--no-labels", "--out", "sweep.npz"]) == 0
    with np.load(folder / "sweep.npz") as file:
        assert file["error"].shape == (3,)
        assert file["error"].max() < 1e-6
    assert re.search(r"^error +\d\.\de-", capsys.readouterr().out, flags=re.MULTILINE)


def test_motion_that_ends_early_writes_the_rows_it_has(folder: Path) -> None:
    # the table rests below the chain: what bounces comes to rest, or never arrives
    arguments = "--parameter amplitude --values 0 --offset -0.1 --frequency 1 --restitution 0.5"
    assert main(["sweep", *arguments.split(), "--no-progress", "--out", "sweep.csv"]) == 0
    assert len(rows_of(folder / "sweep.csv")) - 1 < 100


def test_sweep_of_two_observables_draws_both(folder: Path) -> None:
    arguments = [*SWEEP, "--observable", "relative_velocity,energy", "--out", "sweep.svg"]
    assert main(arguments) == 0
    assert (folder / "sweep.svg").read_text().count('<g id="axes_') == 2


def test_resumed_sweep_writes_the_same_bytes(folder: Path) -> None:
    assert main([*SWEEP, "--store", "sweep.h5", "--out", "a.csv"]) == 0
    assert main([*SWEEP, "--store", "sweep.h5", "--out", "b.csv"]) == 0
    assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()


def test_a_start_that_is_given_is_the_first_state_of_a_sweep(folder: Path) -> None:
    arguments = "sweep --masses 1 --values 0.9 --transient 0 --keep 3 --no-labels --no-progress"
    assert main([*arguments.split(), "--position", "0.3", "--out", "a.csv"]) == 0
    chain = ImpactChain(masses=1, frequency=0.9)
    record = chain.simulate(impacts=3, start=chain.state([0.3]))
    written = [float(row[2]) for row in rows_of(folder / "a.csv")[1:]]
    assert written == record.relative_velocity.tolist()


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
@pytest.mark.parametrize("command", ["simulate", "sweep", "map", "continue", "work-precision"])
def test_every_command_draws_in_every_format(command: str, ending: str, folder: Path) -> None:
    arguments = {
        "simulate": "--frequency 0.87",
        "sweep": "--values 0.87 --keep 20 --no-labels",
        "map": "--x frequency,0.8,0.9,2 --y damping,0.1,0.2,2 --transient 9 --keep 9",
        "continue": "--frequency 0.87 --periods 3 --from 0.86 --to 0.88",
        "work-precision": "--frequency 0.87 --impacts 3 --methods dynkit",
    }[command]
    quiet = [] if command in ("simulate", "continue") else ["--no-progress"]
    small = ["--masses", "2", *arguments.split(), *quiet]
    assert main([command, *small, "--out", f"picture.{ending}"]) == 0
    begin = (folder / f"picture.{ending}").read_bytes()[:5]
    assert begin == {"png": b"\x89PNG\r", "svg": b"<?xml", "pdf": b"%PDF-"}[ending]


def test_error_against_run_time_of_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "mine.toml").write_text(
        'masses = 2\nfrequency = 0.87\nimpacts = 3\nmethods = ["dynkit", "DOP853"]\n'
        "progress = false\n"
    )
    assert main(["work-precision", "--config", "mine.toml", "--out", "times.csv"]) == 0
    header, *rows = (folder / "times.csv").read_text().splitlines()
    assert {"method", "tolerance", "error", "seconds"} <= set(header.split(","))
    assert len(rows) == 5
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert len(re.findall(r"^DOP853 ", printed, flags=re.MULTILINE)) == 4
    assert re.search(r"^dynkit +- +< \S+ .* not known better$", printed, flags=re.MULTILINE)


def test_summary_names_label_and_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--frequency", "0.87", "--out", "motion.csv"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^label +P\(1,3\)", printed, flags=re.MULTILINE)
    assert re.search(r"^written +motion.csv$", printed, flags=re.MULTILINE)
