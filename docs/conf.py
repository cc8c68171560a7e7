"""Settings of the documentation, built by `make docs`."""

import shutil
import sys
from contextlib import redirect_stdout
from enum import Enum
from io import StringIO
from pathlib import Path
from types import BuiltinFunctionType, MethodDescriptorType

from sphinx.application import Sphinx

import dynkit
from dynkit.cli import COMMANDS, main

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_extensions"), str(HERE.parent)]

from reference import analysis_page  # noqa: E402
from scripts import draw_all, gallery_page  # noqa: E402

# Sphinx reads sources from one folder only, and does not follow links.
shutil.copytree(
    HERE.parent / "tutorials",
    HERE / "tutorials",
    ignore=shutil.ignore_patterns("__pycache__", "*.py", "cusumano_bai_1993"),
    dirs_exist_ok=True,
)

project = "dynkit"
author = "The dynkit developers"
project_copyright = "the dynkit developers, BSD-3-Clause"
release = dynkit.__version__
version = release

extensions = [
    "glossary_links",
    "mathml",
    "myst_nb",
    "numpydoc",
    "source_links",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "whole_numbers",
]
# jupyter_execute holds the pictures of notebooks, beside the built pages.
exclude_patterns = ["_build", "jupyter_execute", "paper", "README.md"]
templates_path = ["_templates"]
nitpicky = False
suppress_warnings = ["myst.strikethrough"]

# Notebooks contain their outputs; the tests execute them and compare.
nb_execution_mode = "off"
# cells that are folded are solutions of exercises
nb_code_prompt_show = "Solution"
nb_code_prompt_hide = "Solution"
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"
autodoc_inherit_docstrings = True
numpydoc_class_members_toctree = False
numpydoc_show_class_members = False
numpydoc_validation_checks: set[str] = set()

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = f"dynkit {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
# Pages without pages below them need no sidebar.
ALONE = (
    "install",
    "benchmarks",
    "comparison",
    "coming-from",
    "limits",
    "glossary",
    "release-notes",
)
html_sidebars = {page: [] for page in (*ALONE, "gallery/index", "release-notes")}
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}


def help_of(*arguments: str) -> str:
    """Return the help of the command, as a block of text."""
    with redirect_stdout(StringIO()) as text:
        main([*arguments, "--help"])
    return f"```text\n{text.getvalue().strip()}\n```"


pages = ["# The `dynkit` command", help_of()]
for command in COMMANDS:
    pages += [f"## `dynkit {command}`", help_of(command)]
(HERE / "api" / "command.md").write_text("\n\n".join(pages) + "\n", encoding="utf-8")
(HERE / "api" / "analysis.md").write_text(analysis_page(), encoding="utf-8")
draw_all()
(HERE / "gallery" / "index.md").write_text(gallery_page(), encoding="utf-8")


def keep_values(_app: Sphinx, _what: str, _name: str, member: object, *_: object) -> bool | None:
    """Include values of enumerations, which have no docstrings, and exclude methods of str."""
    if isinstance(member, MethodDescriptorType | BuiltinFunctionType):
        return True
    return False if isinstance(member, Enum) else None


def setup(app: Sphinx) -> None:
    """Connect the event handler."""
    app.connect("autodoc-skip-member", keep_values)
