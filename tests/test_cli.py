"""The `dynkit` command: exit codes, messages, files, help."""

import csv
import io
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dynkit import sweep
from dynkit.cli import main
from dynkit.cli.options import values_of
from dynkit.cli.reproduce import reproduce
from dynkit.cli.reproduce.paper import ITEMS
from dynkit.cli.reproduce.settling import impacts_until_settled
from dynkit.cli.reproduce.workshop import SteadyTableChain
from dynkit.systems import ImpactChain

SWEEP = ["sweep", "--from", "0.86", "--to", "0.88", "--step", "0.01", "--no-progress"]

# (arguments, the line on stderr)
BAD_INPUT = [
    (["simulate"], "simulate: error: frequency must be given"),
    (
        ["simulate", "--frequency", "0.9", "--restitution", "1.2"],
        "simulate: error: restitution must lie in [0, 1]; got 1.2",
    ),
    (
        ["simulate", "--frequency", "0"],
        "simulate: error: frequency must be positive; got 0",
    ),
    (
        ["simulate", "--frequency", "nan"],
        "simulate: error: frequency must be a finite number; got nan",
    ),
    (
        ["simulate", "--frequency", "fast"],
        "simulate: error: frequency must be a finite number; got 'fast'",
    ),
    (
        ["simulate", "--frequency", "1", "--damping", "-0.1"],
        "simulate: error: damping must not be negative; got -0.1",
    ),
    (
        ["simulate", "--frequency", "1", "--masses", "1,0,1"],
        "simulate: error: masses[1] must be positive; got 0.0",
    ),
    (
        ["simulate", "--frequency", "1", "--masses", "2.5"],
        "simulate: error: masses must be a positive integer; got 2.5",
    ),
    (
        ["simulate", "--frequency", "1", "--masses", "2", "--position=0,-1"],
        "simulate: error: position[1] must not be below the table at 0.0; got -1.0",
    ),
    (
        ["simulate", "--frequency", "1", "--impacts", "many"],
        "simulate: error: impacts must be a positive integer; got 'many'",
    ),
    (
        ["simulate", "--frequency", "1", "--observable", "speed"],
        (
            "simulate: error: observable must be one of: time, phase, relative_velocity, energy, "
            "position, velocity; got 'speed'"
        ),
    ),
    (
        ["simulate", "--frequency", "1", "--out", "motion.pdf"],
        "simulate: error: out must end in .csv, .npz, .h5, .png, .svg; got 'motion.pdf'",
    ),
    (
        ["simulate", "--frequency", "1", "--out", "missing/motion.csv"],
        (
            "simulate: error: out must be writable; got 'missing/motion.csv' "
            "(No such file or directory)"
        ),
    ),
    (
        ["simulate", "missing.toml"],
        "simulate: error: missing.toml cannot be read: No such file or directory",
    ),
    (["simulate", "--frequncy", "1"], "simulate: error: there is no argument --frequncy"),
    (
        ["sweep"],
        "sweep: error: from must be given, or values",
    ),
    (
        ["sweep", "--values", "0.5,nan"],
        "sweep: error: values[1] must be a finite number; got nan",
    ),
    (
        ["sweep", "--values", "0.5,0"],
        "sweep: error: frequency must be positive; got 0.0 in values[1]",
    ),
    (
        ["sweep", "--from", "1", "--to", "2", "--step", "-0.1"],
        "sweep: error: step must lead from 1.0 to 2.0; got -0.1",
    ),
    (
        ["sweep", "--from", "1", "--to", "2", "--step", "0"],
        "sweep: error: step must lead from 1.0 to 2.0; got 0.0",
    ),
    (
        ["sweep", "--from", "1", "--to", "2", "--step", "1e-9"],
        "sweep: error: step must not give more than 1000000 values; got 1e-09",
    ),
    (
        ["sweep", "--from", "1", "--values", "1,2"],
        "sweep: error: from must not be given beside values; got 1",
    ),
    (
        ["sweep", "--values", "1", "--frequency", "1"],
        "sweep: error: frequency must not be given when it is swept; got 1",
    ),
    (
        ["sweep", "--values", "1", "--parameter", "masses"],
        (
            "sweep: error: parameter must be one of: springs, damping, restitution, amplitude, "
            "offset, frequency; got 'masses'"
        ),
    ),
    (
        ["sweep", "--values", "1", "--parameter", "restitution"],
        "sweep: error: frequency must be given",
    ),
    (
        ["sweep", "--values", "1", "--keep", "0"],
        "sweep: error: keep must be a positive integer; got 0",
    ),
    (
        ["sweep", "--values", "1", "--store", "missing/sweep.h5"],
        "sweep: error: store must be writable; got 'missing/sweep.h5' (No such file or directory)",
    ),
    (
        ["sweep", "--values", "1", "--store", "a.h5", "--out", "a.h5"],
        "sweep: error: out must be another file than store; got 'a.h5'",
    ),
    (
        ["reproduce", "--out", "results", "--only", "figure-9"],
        f"reproduce: error: only must hold items among {', '.join(ITEMS)}; got 'figure-9'",
    ),
    (
        ["reproduce"],
        "reproduce: error: the following arguments are required: --out",
    ),
]


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


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("arguments", "line"), BAD_INPUT, ids=lambda part: str(part)[:60])
def test_bad_input_is_refused_on_one_line_and_nothing_is_written(
    arguments: list[str], line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.err == f"dynkit {line}\n"
    assert printed.out == ""
    assert list(folder.iterdir()) == []


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


def test_results_folder_that_is_a_file_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "results").write_text("mine")
    assert main(["reproduce", "--out", "results"]) == 2
    assert "out must be writable; got 'results'" in capsys.readouterr().err
    assert (folder / "results").read_text() == "mine"


def test_store_of_another_sweep_is_refused_and_kept(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*SWEEP, "--store", "sweep.h5"]) == 0
    before = (folder / "sweep.h5").read_bytes()
    assert main([*SWEEP, "--store", "sweep.h5", "--damping", "0.2"]) == 2
    assert "damping 0.1; got 0.2" in capsys.readouterr().err
    assert (folder / "sweep.h5").read_bytes() == before


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
    monkeypatch.setattr(csv, "writer", lambda _: Full())
    assert main(["simulate", "--frequency", "1", "--out", "motion.csv"]) == 1
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("motion.csv", "old")]


def test_module_runs_as_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dynkit", "--version"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"dynkit \d+\.\d+\.\d+\n", done.stdout)


# --- help -----------------------------------------------------------------------------------------


def toml_files_of(text: str) -> dict[str, str]:
    """Files that a help text shows: ``name.toml may hold:`` and indented lines."""
    found = re.findall(r"^(\S+\.toml) may hold:\n((?:  .*\n?)+)", text, flags=re.MULTILINE)
    return dict(found)


def examples_of(text: str) -> list[list[str]]:
    return [line.split()[1:] for line in re.findall(r"^  (dynkit .*)$", text, flags=re.MULTILINE)]


@pytest.mark.parametrize("command", ["simulate", "sweep", "reproduce"])
def test_examples_of_the_help_run(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = described([command], capsys)
    for name, lines in toml_files_of(text).items():
        (folder / name).write_text("\n".join(map(str.strip, lines.splitlines())))
    examples = [each for each in examples_of(text) if command != "reproduce" or "--only" in each]
    assert examples
    for arguments in examples:
        assert main(arguments) == 0, arguments
        for option in ("--out", "--store"):
            if option in arguments:
                assert (folder / arguments[arguments.index(option) + 1]).exists()


@pytest.mark.parametrize("command", ["simulate", "sweep"])
def test_help_shows_a_file(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert toml_files_of(described([command], capsys))


def test_examples_of_the_main_help_are_complete(capsys: pytest.CaptureFixture[str]) -> None:
    commands = [arguments[0] for arguments in examples_of(described([], capsys))]
    assert commands[:3] == ["simulate", "sweep", "reproduce"]


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
    assert head == ["time", "phase", "relative_velocity", "energy"]
    written = np.array(rows, dtype=float)
    assert np.array_equal(written[:, 2], record.relative_velocity)
    assert np.array_equal(written[:, 0], record.time)


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_simulate_writes_arrays(ending: str, folder: Path) -> None:
    arguments = "simulate --frequency 0.87 --impacts 7 --observable position,energy --out"
    assert main([*arguments.split(), f"motion.{ending}"]) == 0
    record = ImpactChain(frequency=0.87).attractor(impacts=7).record
    if ending == "npz":
        with np.load(folder / "motion.npz") as file:
            position, frequency = file["position"], float(file["frequency"])
    else:
        arrays, parameters = hdf5_of(folder / "motion.h5")
        position, frequency = arrays["position"], parameters["frequency"]
    assert np.array_equal(position, record.position)
    assert frequency == 0.87


def test_sweep_writes_what_sweep_finds(folder: Path) -> None:
    assert main([*SWEEP, "--keep", "9", "--out", "sweep.csv"]) == 0
    found = sweep(
        ImpactChain(frequency=0.86), "frequency", [0.86, 0.87, 0.88], keep=9, progress=False
    )
    head, *rows = rows_of(folder / "sweep.csv")
    assert head == ["frequency", "impact", "relative_velocity", "label"]
    velocity = np.array([row[2] for row in rows], dtype=float)
    assert np.array_equal(velocity, found.observable("relative_velocity").ravel())
    assert {row[3] for row in rows} == {"P(1,3)"}


def test_sweep_writes_arrays_with_labels(folder: Path) -> None:
    assert main([*SWEEP, "--keep", "9", "--out", "sweep.h5"]) == 0
    arrays, parameters = hdf5_of(folder / "sweep.h5")
    assert arrays["relative_velocity"].shape == (3, 9)
    assert arrays["labels"].tolist() == [b"P(1,3)"] * 3
    assert parameters["parameter"] == "frequency"


def test_sweep_of_two_observables_draws_both(folder: Path) -> None:
    arguments = [*SWEEP, "--observable", "relative_velocity,energy", "--out", "sweep.svg"]
    assert main(arguments) == 0
    assert (folder / "sweep.svg").read_text().count('<g id="axes_') == 2


def test_resumed_sweep_writes_the_same_bytes(folder: Path) -> None:
    assert main([*SWEEP, "--store", "sweep.h5", "--out", "a.csv"]) == 0
    assert main([*SWEEP, "--store", "sweep.h5", "--out", "b.csv"]) == 0
    assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()


def test_summary_names_label_and_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--frequency", "0.87", "--out", "motion.csv"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^label +P\(1,3\)", printed, flags=re.MULTILINE)
    assert re.search(r"^written +motion.csv$", printed, flags=re.MULTILINE)


# --- the paper's figures --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All items but the blow-ups, which take as long as all others."""
    folder = tmp_path_factory.mktemp("results")
    reproduce(str(folder), [item for item in ITEMS if item != "figure-5"], log=io.StringIO())
    return folder


def cells(report: str, first: str) -> list[str]:
    """The cells of the table row that begins with a text."""
    (row,) = re.findall(rf"^\| {re.escape(first)} \|.*$", report, flags=re.MULTILINE)[:1]
    return [cell.strip() for cell in str(row).strip("|").split("|")]


@pytest.fixture
def report(results: Path) -> str:
    return (results / "report.md").read_text()


def test_reproduce_writes_a_report_and_each_figure_twice(results: Path) -> None:
    figures = {f"{name}.{end}" for name in ITEMS if name[:6] == "figure" for end in ("png", "svg")}
    expected = figures - {"figure-5.png", "figure-5.svg"} | {"report.md"}
    assert {path.name for path in results.iterdir()} == expected


def test_reproduced_figures_are_small(results: Path) -> None:
    assert max(path.stat().st_size for path in results.iterdir()) < 1_000_000


def test_report_embeds_every_figure(results: Path, report: str) -> None:
    embedded = re.findall(r"!\[.*\]\((.*)\)", report)
    assert sorted(embedded) == sorted(path.name for path in results.glob("*.png"))


def test_report_says_what_was_left_out(report: str) -> None:
    assert "Left out of this run: figure-5." in report


def test_report_tells_each_natural_frequency(report: str) -> None:
    assert cells(report, "1")[1:4] == ["0.150", "0.149460", "-0.000540"]
    assert cells(report, "10")[1:4] == ["1.978", "1.977662", "-0.000338"]


def test_report_finds_the_expected_labels(report: str) -> None:
    assert cells(report, "labels along the sweep")[2] == "14 of 14 agree"


def test_report_finds_the_ratios_at_the_restitution(report: str) -> None:
    assert cells(report, "200")[2].startswith("0.8500000000")


@pytest.mark.parametrize("constant", ["amplitude", "velocity"])
def test_report_finds_the_peaks(constant: str, report: str) -> None:
    low, high = cells(report, f"peaks, constant {constant}")[2].split(" and ")
    assert float(low) == pytest.approx(0.202, abs=0.0021)
    assert float(high) == pytest.approx(0.408, abs=0.0021)


@pytest.mark.parametrize(
    ("frequency", "found"),
    [("0.40816", "P(inf,2)"), ("0.36", "P(74,32)"), ("1.336", "P(2,5)"), ("0.35", "P(39,15)")],
)
def test_report_tells_where_the_paper_does_not_hold(
    frequency: str, found: str, report: str
) -> None:
    assert cells(report, f"motion at {frequency}")[2].startswith(found)


def test_report_measures_how_slowly_the_sticking_motion_settles(report: str) -> None:
    (ratio,) = re.findall(r"by a factor (\d\.\d+) on average", report)
    assert float(ratio) == pytest.approx(0.87, abs=0.02)


def test_reproduce_of_some_items_writes_only_these(folder: Path) -> None:
    assert main(["reproduce", "--out", "here/results", "--only", "table-a1"]) == 0
    assert [path.name for path in (folder / "here/results").iterdir()] == ["report.md"]


def test_steady_table_has_one_velocity_at_all_frequencies() -> None:
    chain = SteadyTableChain(frequency=0.14, table_velocity=0.014)
    products = [chain.replace(frequency=w).amplitude * w for w in (0.14, 0.5, 2.0)]
    assert products == pytest.approx([0.014] * 3, rel=1e-15)


def test_steady_table_chain_moves_as_a_chain_of_that_amplitude() -> None:
    steady = SteadyTableChain(frequency=0.5, table_velocity=0.05).simulate(impacts=50)
    plain = ImpactChain(frequency=0.5, amplitude=0.1).simulate(impacts=50)
    assert np.array_equal(steady.relative_velocity, plain.relative_velocity)


def test_steady_table_refuses_an_amplitude_of_its_own() -> None:
    with pytest.raises((TypeError, ValueError), match="amplitude"):
        SteadyTableChain(frequency=0.5).replace(amplitude=0.2)


def test_motion_that_has_settled_is_settled_from_the_first_impact_on() -> None:
    record = ImpactChain(frequency=0.87).attractor(transient=3000, impacts=50).record
    assert impacts_until_settled(record, 1) == 0


def test_chaotic_motion_never_settles() -> None:
    record = ImpactChain(frequency=1.346).attractor(impacts=500).record
    assert impacts_until_settled(record, 1) is None
