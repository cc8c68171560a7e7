"""`report.html` is one page that says all that `report.md` says."""

from __future__ import annotations

import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tutorials.cusumano_bai_1993.markdown import inline, to_html
from tutorials.cusumano_bai_1993.page import write_page
from tutorials.cusumano_bai_1993.section import Finding, Section, table

DRAWING = b'<svg xmlns="http://www.w3.org/2000/svg"><text>drawn</text></svg>'
EMPTY = {"br", "img", "link", "meta"}


class Page(HTMLParser):
    """The texts of cells, the sources of pictures, and whether all tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.sources: list[str] = []
        self.references: list[str] = []
        self.folded: list[bool] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in EMPTY:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")
        given = dict(attrs)
        self.folded += ["open" not in given] if tag == "details" else []
        self.sources += [given["src"] or ""] if "src" in given else []
        self.references += [given["href"] or ""] if "href" in given else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data
        if {"td", "th"} & set(self.open):
            self.cells[-1] += data


@pytest.fixture
def page(tmp_path: Path) -> Page:
    for name in ("machine", "figure-x"):
        (tmp_path / f"{name}.svg").write_bytes(DRAWING)
    rows = [["1", "a < b & c"], ["2", "`code` and $\\omega_1$"]]
    section = Section(
        "figure-x",
        "Figure x: what is drawn",
        f"Some words.\n\n{table(['i', 'what'], rows)}",
        [
            Finding("limit", "0.85", "0.8500", "2e-16", agrees=True),
            Finding("label", "P(1,2)", "P(1,3)", "none", agrees=False),
            Finding("cause", "unknown", "known", "none"),
        ],
        ["figure-x"],
    )
    path = write_page(tmp_path / "x.html", "A & B", "Opening.", [section], [("Cost", "1 s")])
    return Page(path.read_text(encoding="utf-8"))


def test_all_tags_are_closed(page: Page) -> None:
    assert page.open == []


def test_the_page_needs_no_other_file_and_no_other_host(page: Page) -> None:
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.sources)
    assert page.references == ["#figure-x"]


def test_figures_are_in_the_page(page: Page) -> None:
    assert [b64decode(source.partition(",")[2]) for source in page.sources] == [DRAWING] * 2


def test_cells_say_what_the_table_says(page: Page) -> None:
    assert page.cells[-6:] == ["i", "what", "1", "a < b & c", "2", "code and ω1"]


def test_the_first_table_is_of_what_differs_and_the_others_are_folded(page: Page) -> None:
    tables = [page.cells[k + 5 : k + 10] for k in (0, 10, 20)]
    assert tables == [
        ["Figure x", "label", "P(1,2)", "P(1,3)", "none"],
        ["Figure x", "limit", "0.85", "0.8500", "2e-16"],
        ["Figure x", "cause", "unknown", "known", "none"],
    ]
    assert page.folded == [False, True, True]
    assert "Of 2 results that can be compared with the paper, 1 agree." in page.words


def test_the_statement_of_the_paper_stands_beside_the_figure(page: Page) -> None:
    after = page.words.partition("Some words.")[0]
    assert re.search(r"limit\s*paper 0\.85\s*found 0\.8500\s*error 2e-16", after)


@pytest.mark.parametrize(
    ("markdown", "html"),
    [
        ("$\\omega_{10}$", "<i>ω<sub>10</sub></i>"),
        ("$x^T K x$", "<i>x<sup>T</sup> K x</i>"),
        ("$\\sqrt{2E}$", "<i>√(2E)</i>"),
        ("$2 \\sin((2i-1)\\pi / 3)$", "<i>2 sin((2i-1)π/ 3)</i>"),
        ("to 1e-06, 2", 'to <span class="one">1e-06</span>, 2'),
        ("<b> & `<i>`", "&lt;b&gt; &amp; <code>&lt;i&gt;</code>"),
    ],
)
def test_formulas_and_code(markdown: str, html: str) -> None:
    assert inline(markdown) == html


FOLDER = Path(__file__).parents[2] / "tutorials" / "cusumano_bai_1993"
TEMPLATE = (FOLDER / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("cell", "numbers"),
    [
        ("2e-16", [2e-16]),
        ("+0.000042", [4.2e-5]),
        ("-.5", [-0.5]),
        ("0.87193 ± 1e-04", [0.87193, 1e-4]),
        ("22.617 %", [22.617]),
        ("-0.689322+0.724455j", [-0.689322, 0.724455]),
        ("CB 0.1963241226 (6e-14)", [0.1963241226, 6e-14]),
        ("P(10,5)", [10.0, 5.0]),
        ("P(inf,2)", [2.0]),
        ("none", []),
    ],
)
def test_sorting_sees_all_numbers_of_a_cell(cell: str, numbers: list[float]) -> None:
    (expression,) = re.findall(r"const number = /(.*)/i;", TEMPLATE)
    found = re.split(expression, cell, flags=re.IGNORECASE)[1::2]
    assert [float(piece) for piece in found] == numbers


def test_printed_pages_have_margins_and_no_cut_tables() -> None:
    printed = TEMPLATE.partition("@media print")[2].partition("</style>")[0]
    assert "@page { margin: 15mm; }" in TEMPLATE
    assert ".wide { overflow: visible; background: none; }" in printed
    assert "th { white-space: normal; }" in printed


def test_paragraphs_are_apart() -> None:
    assert to_html("one\nline\n\nanother") == "<p>one line</p>\n<p>another</p>"
