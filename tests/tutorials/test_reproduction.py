"""The reproduction of Cusumano & Bai (1993): its files, and what its report finds."""

import io
import re
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import _next, _received, reproduce
from tutorials.cusumano_bai_1993.__main__ import main
from tutorials.cusumano_bai_1993.paper import ITEMS
from tutorials.cusumano_bai_1993.settling import impacts_until_settled
from tutorials.cusumano_bai_1993.workshop import SteadyTableChain, frequencies

PICTURES = tuple(f"figure-{number}" for number in (7, 8, 9, 10, 11, 12, 13, 16, 17))
"""Items that show single motions; they have tests of their own."""

LONG = ("figure-4-branches", "figure-5", "resonances", *PICTURES, "table-1")
"""Items that take as long as all others; but for figure 5 they have tests of their own."""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All items but the long ones."""
    folder = tmp_path_factory.mktemp("results")
    reproduce(str(folder), [item for item in ITEMS if item not in LONG], log=io.StringIO())
    return folder


def test_an_item_made_by_another_process_is_part_of_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tutorials.cusumano_bai_1993.BESIDE", ("figure-3",))
    log = io.StringIO()
    page = reproduce(str(tmp_path), ["table-a1", "figure-3"], log=log)
    assert page == tmp_path / "report.html"
    assert "s, meanwhile" in log.getvalue()
    assert cells((tmp_path / "report.md").read_text(), "200")[2].startswith("0.8500000000")
    assert (tmp_path / "figure-3.png").exists()


def test_two_processes_take_each_item_once() -> None:
    left = get_context("spawn").Array("i", [0, 5])
    assert [_next(left, end) for end in (0, 1, 1, 0, 0)] == [0, 4, 3, 1, 2]
    assert [_next(left, end) for end in (0, 1)] == [None, None]


def test_the_end_of_the_other_process_is_not_waited_for_in_vain() -> None:
    receiver, sender = get_context("spawn").Pipe(duplex=False)
    sender.close()
    with pytest.raises(RuntimeError, match="second process ended early"):
        _received(receiver)


def cells(report: str, first: str) -> list[str]:
    """The cells of the table row that begins with a text."""
    (row,) = re.findall(rf"^\| {re.escape(first)} \|.*$", report, flags=re.MULTILINE)[:1]
    return [cell.strip() for cell in str(row).strip("|").split("|")]


def finding(report: str, what: str) -> list[str]:
    """The cells of a row of the summary, from its name on."""
    (row,) = re.findall(rf"^\| [^|]* \| ({re.escape(what)} \|.*) \|$", report, flags=re.MULTILINE)
    return [cell.strip() for cell in str(row).split("|")]


@pytest.fixture
def report(results: Path) -> str:
    return (results / "report.md").read_text()


def test_reproduce_writes_a_report_and_each_figure_twice(results: Path) -> None:
    figures = {f"{name}.{end}" for name in ITEMS if name[:6] == "figure" for end in ("png", "svg")}
    expected = figures - {f"{name}.{end}" for name in LONG for end in ("png", "svg")}
    expected |= {"report.md", "report.html", "machine.png", "machine.svg"}
    assert {path.name for path in results.iterdir()} == expected


def test_reproduced_figures_are_small(results: Path) -> None:
    figures = [*results.glob("*.png"), *results.glob("*.svg")]
    assert max(path.stat().st_size for path in figures) < 1_000_000


def test_report_embeds_every_figure(results: Path, report: str) -> None:
    embedded = re.findall(r"!\[.*\]\((.*)\)", report)
    assert embedded[:2] == ["machine.png", "figure-4.png"]
    assert sorted(set(embedded)) == sorted(path.name for path in results.glob("*.png"))


def test_report_begins_with_what_was_found_and_what_differs(report: str) -> None:
    heads = re.findall(r"^## (.*)$", report, flags=re.MULTILINE)
    assert [re.sub(r" \(\d+\)", "", head) for head in heads[:2]] == ["Differences", "Agreements"]
    differ = report.partition("## Differences")[2].partition("## Agreements")[0]
    assert "| motion at 0.40816 |" in differ
    assert "| labels along the sweep |" not in differ
    assert re.search(r"Of \d+ results that can be compared with the paper, \d+ agree\.", report)


def test_report_says_what_was_left_out(report: str) -> None:
    assert f"Left out of this run: {', '.join(LONG)}." in report


def test_report_tells_each_natural_frequency(report: str) -> None:
    assert cells(report, "1")[1:4] == ["0.150", "0.149460", "-0.000540"]
    assert cells(report, "10")[1:4] == ["1.978", "1.977662", "-0.000338"]


def test_report_finds_the_expected_labels(report: str) -> None:
    assert finding(report, "labels along the sweep")[2] == "14 of 14 agree"


def test_report_finds_the_ratios_at_the_restitution(report: str) -> None:
    assert cells(report, "200")[2].startswith("0.8500000000")


@pytest.mark.parametrize("constant", ["amplitude", "velocity"])
def test_report_finds_the_peaks(constant: str, report: str) -> None:
    low, high = finding(report, f"peaks, constant {constant}")[2].split(" and ")
    assert float(low) == pytest.approx(0.202, abs=0.0021)
    assert float(high) == pytest.approx(0.408, abs=0.0021)


@pytest.mark.parametrize(
    ("frequency", "found"),
    [("0.40816", "P(inf,2)"), ("0.36", "P(74,32)"), ("1.336", "P(2,5)"), ("0.35", "P(39,15)")],
)
def test_report_tells_where_the_paper_does_not_hold(
    frequency: str, found: str, report: str
) -> None:
    assert finding(report, f"motion at {frequency}")[2].startswith(found)


def test_report_says_which_statements_of_the_paper_do_not_hold(report: str) -> None:
    (said,) = re.findall(r"Of 5 statements .* 4 do not hold: (.*)\.", report)
    assert said == "first natural frequency, motion at 0.40816, motion at 1.336, motion at 0.35"


def test_report_measures_how_slowly_the_sticking_motion_settles(report: str) -> None:
    (ratio,) = re.findall(r"by a factor (\d\.\d+) on average", report)
    assert float(ratio) == pytest.approx(0.87, abs=0.02)


def test_reproduce_of_some_items_writes_only_these(tmp_path: Path) -> None:
    folder = tmp_path / "here" / "results"
    main(["--out", str(folder), "--only", "table-a1"])
    files = ["machine.png", "machine.svg", "report.html", "report.md"]
    assert sorted(path.name for path in folder.iterdir()) == files


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["--out", "results", "--only", "figure-18"],
            f"only must hold items among {', '.join(ITEMS)}; got 'figure-18'",
        ),
        (["--out", ""], "out must be a folder; got ''"),
        (["--out", "taken"], "out must be writable; got 'taken' (File exists)"),
        ([], "the following arguments are required: --out"),
    ],
)
def test_bad_arguments_are_refused_and_nothing_is_written(
    arguments: list[str],
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.err.endswith(f"cusumano_bai_1993: error: {line}\n")
    assert printed.out == ""
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("taken", "mine")]


def test_the_example_of_the_help_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    program = "  python -m tutorials.cusumano_bai_1993 "
    lines = [x for x in capsys.readouterr().out.splitlines() if x.startswith(program)]
    (example,) = [x for x in lines if "--only" in x]
    main(example.removeprefix(program).split())
    assert (tmp_path / "results" / "report.html").exists()


def test_frequencies_are_as_printed_and_include_the_last() -> None:
    found = frequencies((0.14, 2.0, 0.002))
    assert (len(found), found[0], found[-1]) == (931, 0.14, 2.0)
    assert found[366] == 0.872  # 0.14 + 366 * 0.002 is 0.8720000000000001


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
