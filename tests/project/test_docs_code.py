"""The code of the documents runs, prints what its comments say, and draws what the text says.

Of a ```python block, the comment beside a ``print``, and the comments in the lines below it, are
its output: words must be the same, numbers to their last printed digit.
"""

from __future__ import annotations

import base64
import importlib
import io
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.backend_bases import FigureCanvasBase

from dynkit.cli import COMMANDS, main
from tests.pictures import describe_pictures, described, description, overprinted

ROOT = Path(__file__).parents[2]
HOW_TO = "docs/how-to/"

_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", text(page), flags=re.DOTALL)


def expected(block: str) -> list[str]:
    """Return the lines of output that the comments of a block show."""
    found: list[str] = []
    within = False
    for line in block.splitlines():
        code, mark, comment = line.partition("# ")
        within = "print(" in code or (within and bool(mark) and not code.strip())
        if within and mark:
            found.append(comment)
    return found


def run(page: str) -> Iterator[tuple[list[str], list[str], dict[str, Any]]]:
    """Run the blocks of a page, in one namespace: what each shows, prints, and has defined."""
    program = ModuleType("__main__")  # so that what it defines can be pickled
    names: dict[str, Any] = vars(program)
    with mpl.rc_context():  # a page may choose a style
        for block in blocks(page):
            output = io.StringIO()
            own, sys.modules["__main__"] = sys.modules["__main__"], program
            try:
                with redirect_stdout(output):
                    exec(compile(block, page, "exec", dont_inherit=True), names)
            finally:
                sys.modules["__main__"] = own
            yield expected(block), output.getvalue().splitlines(), names


def agrees(shown: str, printed: str) -> bool:
    """Whether words are the same, and numbers within one unit of the last digit that is shown."""
    if _NUMBER.sub("#", shown) != _NUMBER.sub("#", printed):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= 1.01 * _unit(a) for a, b in pairs)


def _unit(number: str) -> float:
    mantissa, _, exponent = number.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals else 0.0


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of their own for the files, whose pictures say what they show."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(FigureCanvasBase, "print_figure", FigureCanvasBase.print_figure)
    describe_pictures()
    with mpl.rc_context():  # a page sets what it likes
        yield tmp_path
    plt.close("all")


def shows(path: Path) -> str:
    return described(base64.b64encode(path.read_bytes()).decode())


def test_output_is_read_from_the_comments_of_prints() -> None:
    block = "a = 1  # one\nprint(a)  # 1\nfor b in [2, 3]:\n    print(b)\n# 2\n# 3\nc = 4\n# four\n"
    assert expected(block) == ["1", "2", "3"]


def test_output_agrees_to_the_digits_that_are_shown() -> None:
    assert agrees("PD 0.7617", "PD 0.7616")
    assert not agrees("GR 0.8102", "PD 0.8102")
    assert not agrees("GR 0.8102", "GR 0.7617")
    assert not agrees("P(1,3)", "P(1,4)")


@pytest.mark.parametrize(
    "page",
    [
        "docs/index.md",
        "docs/coming-from.md",
        "docs/concepts/chatter.md",
        "docs/concepts/quasi-periodic.md",
        "docs/concepts/continuum.md",
        "docs/mathematics/certified-root.md",
        *(
            f"{HOW_TO}{name}.md"
            for name in (
                "keep-results",
                "look-in-the-browser",
                "make-a-structure",
                "find-all-orbits",
                "add-stops-and-friction",
                "write-your-own-map-or-flow",
                "write-your-own-element",
                "continue-your-own-equations",
                "choose-transient-and-keep",
                "long-runs",
                "troubleshooting",
            )
        ),
    ],
)
def test_code_prints_what_its_page_shows(page: str) -> None:
    assert_prints_what_is_shown(page)


def assert_prints_what_is_shown(page: str) -> None:
    for shown, printed, _ in run(page):
        assert len(shown) == len(printed), (shown, printed)
        assert all(map(agrees, shown, printed)), (shown, printed)


def commands(page: str) -> list[list[str]]:
    """Commands of a page, in lines of their own or within a sentence, without `dynkit`."""
    lines = re.findall(r"^    dynkit (.*)$|`dynkit ([^`]*)`", text(page), flags=re.MULTILINE)
    found = [shlex.split(line or inline) for line, inline in lines]
    return [arguments for arguments in found if arguments[0] != "--help"]


SHOWN = {
    "diagram.png": ["one dots", "texts P(#,#) chaotic"],
    "branch.png": [
        "one dotted 'inadmissible'",
        "one solid 'stable'",
        "texts P(#,#); legend (PD) GR inadmissible stable",
    ],
}
"""What the picture of a command must show."""


def test_commands_draw_what_their_page_says(folder: Path) -> None:
    page = f"{HOW_TO}use-the-command.md"
    for name, lines in re.findall(r"```toml\n# (\S+)\n(.*?)```", text(page), flags=re.DOTALL):
        (folder / name).write_text(lines)
    assert commands(page)
    for arguments in commands(page):
        assert main(arguments) == 0, arguments
        file = arguments[arguments.index("--out") + 1]
        assert (folder / file).stat().st_size > 0
        for part in SHOWN.get(file, []):
            assert part in shows(folder / file), arguments
        (folder / file).unlink()


def test_the_readme_prints_what_it_shows_and_its_command_draws_the_same(folder: Path) -> None:
    assert_prints_what_is_shown("README.md")
    by_code = shows(folder / "diagram.png")
    (folder / "diagram.png").unlink()
    for arguments in commands("README.md"):
        assert main(arguments) == 0
    assert shows(folder / "diagram.png") == by_code
    assert by_code.startswith("frequency")
    for part in SHOWN["diagram.png"]:
        assert part in by_code


def test_the_readme_names_every_command() -> None:
    (names,) = re.findall(r"`dynkit --help`\s+lists ([^.]*)\.", text("README.md"))
    assert re.findall(r"`([a-z-]+)`", names) == list(COMMANDS)


def test_the_code_of_the_readme_is_as_long_as_its_heading_says() -> None:
    lines = [line for line in blocks("README.md")[0].splitlines() if line and line[0] != "#"]
    imports = [line for line in lines if re.match("import|from", line)]
    assert len(lines) - len(imports) <= 10


def test_a_figure_for_a_journal_has_the_branch_beside_the_diagram() -> None:
    *_, (_, _, names) = run(f"{HOW_TO}draw-for-a-journal.md")
    diagram, branch = names["axes"]
    assert diagram.texts
    assert len(diagram.get_lines()[0].get_xdata()) > 1000
    assert {"stable", "inadmissible"} <= {line.get_label() for line in branch.get_lines()}
    assert branch.get_title() == "(b)"
    np.testing.assert_allclose(names["figure"].get_size_inches(), (6.8, 2.6))


def test_every_run_of_the_cluster_page_goes_on_from_one_store() -> None:
    page = text(f"{HOW_TO}run-on-a-cluster.md")
    calls = re.findall(r"parameter_map\(chain, values, (.*)\)", page)
    (command,) = (each for each in commands(f"{HOW_TO}run-on-a-cluster.md") if each[0] == "map")
    assert len(calls) == 3
    assert all("transient=900" in call and 'store="map.h5"' in call for call in calls)
    assert command[command.index("--transient") + 1] == "900"


@pytest.mark.parametrize("name", ["machine.png", "diagram.png"])
def test_the_pictures_of_the_first_page_are_those_that_are_drawn(name: str) -> None:
    sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
    try:
        pictures = importlib.import_module("pictures")
    finally:
        sys.path.pop(0)
    figure = pictures.PICTURES[name]()
    assert shows(pictures.FOLDER / name) == description(figure)
    assert overprinted(figure) == []
    for page in ("README.md", "docs/index.md"):
        assert f"_static/{name})" in text(page)
