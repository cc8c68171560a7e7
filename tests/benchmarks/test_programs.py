"""The programs of the benchmarks: their help, and bad arguments."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.benchmarks.extremes.__main__ import main as extremes
from tests.benchmarks.extremes.cases import GROUPS
from tests.benchmarks.peers import NAMES
from tests.benchmarks.work_precision.__main__ import main as work_precision
from tests.benchmarks.work_precision.jobs import JOBS

Main = Callable[[list[str]], None]
GROUPED, JOBBED = f"groups among {', '.join(GROUPS)}", f"jobs among {', '.join(JOBS)}"
NO_FOLDER = "out must be writable; got 'missing/table.md' (No such file or directory)"

BAD_ARGUMENTS: list[tuple[Main, list[str], str]] = [
    *(
        (extremes, ["--only", only], f"only must hold {GROUPED}; got {got}")
        for only, got in (("sizes", "'sizes'"), ("size,,time", "''"), ("", "''"))
    ),
    (extremes, ["--out", "table.txt"], "out must end in .md; got 'table.txt'"),
    (extremes, ["--out", ""], "out must end in .md; got ''"),
    (extremes, ["--out", "missing/table.md"], NO_FOLDER),
    (extremes, ["size"], "unrecognized arguments: size"),
    *(
        (work_precision, ["--only", only], f"only must hold {JOBBED}; got {only!r}")
        for only in ("chaotic", "")
    ),
    *(
        (
            work_precision,
            ["--methods", names],
            f"methods must hold names among {', '.join(NAMES)}; got {got!r}",
        )
        for names, got in (("RK54", "RK54"), ("RK45,,Moreau", ""))
    ),
    (
        work_precision,
        ["--out", "table.txt"],
        "out must end in .csv, .md, .png, .svg, .pdf; got 'table.txt'",
    ),
    (work_precision, ["--out", "missing/table.md"], NO_FOLDER),
    (work_precision, ["chaos"], "unrecognized arguments: chaos"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("program", "arguments", "line"),
    BAD_ARGUMENTS,
    ids=lambda part: str(getattr(part, "__module__", part))[:40],
)
def test_bad_arguments_are_refused_on_one_line_and_nothing_is_written(
    program: Main,
    arguments: list[str],
    line: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        program(arguments)
    assert ended.value.code == 2
    printed = capsys.readouterr()
    name = sys.modules[program.__module__].__name__.split(".")[2]
    assert printed.err == f"{name}: error: {line}\n"
    assert printed.out == ""
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("program", [extremes, work_precision])
def test_examples_of_the_help_run(
    program: Main, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        program(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    examples = re.findall(r"^  python -m tests\.benchmarks\.\w+ (.*)$", text, flags=re.MULTILINE)
    assert len(examples) == 2
    for example in map(str.split, examples):
        program(example)
        if "--out" in example:
            assert (folder / example[example.index("--out") + 1]).stat().st_size > 0
