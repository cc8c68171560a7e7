"""No text of a file or of the command line becomes code; files are written in one place only."""

import ast
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from dynkit.cli import branch, simulate, sweep, work_precision

ROOT = Path(__file__).resolve().parents[2]

# Names that make code, or objects of any class, of text or bytes.
MODULES = {
    *("pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"),
    *("yaml", "code", "codeop", "runpy", "imp", "ctypes", "subprocess", "pty"),
}
NAMES = {
    *("eval", "exec", "compile", "__import__", "literal_eval", "import_module"),
    *("parse_expr", "parse_latex", "parse_mathematica", "sympify", "lambdify", "nsimplify"),
    *("read_pickle", "loadtxt", "genfromtxt", "fromregex", "popen"),
}
MEMBERS = {("os", "system"), ("sympy", "S"), ("sp", "S")}
KEYWORDS = {"allow_pickle", "shell"}
ALLOWED = {
    # one of the command's own modules
    ("dynkit/cli/__init__.py", "import_module"),
    # bytes of an element that the caller has made, by the check that it can be pickled
    ("dynkit/testing/elements.py", "pickle"),
    # of a number that is an int, a float or one of NumPy's, in strict mode
    ("systems/structure/energies.py", "sympify"),
}
# Work is handed to a user's own processes by pickle, through pipes, never through files.
PIPES = "dynkit/engine/"


def suspicious(tree: ast.AST) -> set[str]:
    """Names in a source that make code of text."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")[0]
            names = {alias.name for alias in node.names}
            found |= ({module} & MODULES) | (names & NAMES)
            found |= {name for name in names if (module, name) in MEMBERS}
        elif isinstance(node, ast.Name):
            found |= {node.id} & NAMES
        elif isinstance(node, ast.Attribute):
            of = node.value.id if isinstance(node.value, ast.Name) else ""
            if node.attr in NAMES and (of, node.attr) != ("re", "compile"):
                found.add(node.attr)
            if (of, node.attr) in MEMBERS:
                found.add(node.attr)
        elif isinstance(node, ast.keyword):
            found |= {node.arg or ""} & KEYWORDS
    return found


@cache
def found_in_sources() -> dict[str, tuple[set[str], set[str]]]:
    """What makes code of text, and what writes files, in each source, which is read once."""
    found = {}
    for folder in ("dynkit", "systems", "analysis", "tutorials"):
        for path in (ROOT / folder).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            found[path.relative_to(ROOT).as_posix()] = suspicious(tree), written(tree)
    return found


def test_no_source_makes_code_of_text() -> None:
    found = {
        (name, each)
        for name, (code, _) in found_in_sources().items()
        for each in code
        if not (name.startswith(PIPES) and each == "pickle")
    }
    assert found == ALLOWED


@pytest.mark.parametrize(
    "source",
    [
        "eval(text)",
        "import pickle",
        "from pickle import load",
        "np.load(file, allow_pickle=True)",
        "sympy.sympify(text)",
        "from sympy import S",
        "import yaml",
        "os.system(text)",
        "builtins.exec(text)",
    ],
)
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert suspicious(ast.parse(source))


MARK = "injected_text"
# Each would leave a file if it ran, in Python, in SymPy, in a shell.
PAYLOADS = [
    f"__import__('pathlib').Path('{MARK}').touch()",
    f"sympify(\"__import__('pathlib').Path('{MARK}').touch()\")",
    f"$(touch {MARK})/`touch {MARK}`;touch {MARK}",
]

CHILD = f"""
import contextlib, io, json, sys
import numpy.testing  # older ones, which older SciPy imports, ask lscpu about the processor

heard = []
def listen(event, arguments):
    if event in ("compile", "exec", "pickle.find_class", "os.system", "subprocess.Popen"):
        if event in ("os.system", "subprocess.Popen") or {MARK!r} in repr(arguments):
            heard.append(event)
    elif event == "pickle.find_class":
        heard.append(event)
sys.addaudithook(listen)
compile("{MARK}", "heard", "eval")  # that it listens
from dynkit.cli import main
codes = []
for arguments in json.load(sys.stdin):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(arguments)
    codes.append([code, said.getvalue()])
json.dump([codes, heard], sys.stdout)
"""


def attacks(folder: Path) -> list[list[str]]:
    """Every option of every command with every payload, given directly and in a TOML file."""
    tasks: list[list[str]] = []
    commands = {
        "simulate": simulate,
        "sweep": sweep,
        "continue": branch,
        "work-precision": work_precision,
    }
    for command, module in commands.items():
        for option in module.OPTIONS:
            for payload in PAYLOADS:
                # a folder that is missing: as names of files they are refused too
                text = f"missing/{payload}" if option.name in ("store", "out") else payload
                file = folder / f"{len(tasks)}.toml"
                file.write_text(f"{option.name} = {json.dumps(text)}\n")
                tasks += [[command, str(file)], [command, f"--{option.name}={text}"]]
                if command == "sweep" and option.name not in ("values", "store", "out"):
                    tasks[-1].append("--values=0.9")
        for payload in PAYLOADS:
            tasks += [[command, payload], [payload], [command, f"--{payload}"]]
    return tasks


def test_no_option_runs_its_text(tmp_path: Path) -> None:
    tasks = attacks(tmp_path)
    found = subprocess.run(
        [sys.executable, "-c", CHILD],
        input=json.dumps(tasks),
        cwd=tmp_path,
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
        text=True,
    )
    outcomes, heard = json.loads(found.stdout)
    assert heard == ["compile"]
    for task, (code, said) in zip(tasks, outcomes, strict=True):
        assert code == 2, task
        assert said.count("\n") == 1, task
        assert said.startswith("dynkit"), task
    assert {path.suffix for path in tmp_path.iterdir()} == {".toml"}


def written(tree: ast.AST) -> set[str]:
    """Calls in a source that write a file in place."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        name = node.func.id if isinstance(node.func, ast.Name) else name
        texts = [
            each.value
            for each in [*node.args, *(keyword.value for keyword in node.keywords)]
            if isinstance(each, ast.Constant) and isinstance(each.value, str)
        ]
        in_place = name in ("write_text", "write_bytes", "tofile", "to_csv", "savetxt")
        if in_place and isinstance(node.func, ast.Attribute):
            found.add(name)
        if name == "open" and any(set(text) & set("wax") and len(text) < 4 for text in texts):
            found.add(name)
    return found


def test_files_are_written_in_one_place_only() -> None:
    found = {name: files for name, (_, files) in found_in_sources().items()}
    assert {name: each for name, each in found.items() if each} == {
        "dynkit/data/atomic_files.py": {"open"}
    }


@pytest.mark.parametrize(
    "source", ["path.write_text(text)", "open(path, 'w')", "path.open(mode='xb')", "a.tofile(path)"]
)
def test_the_search_finds_what_writes(source: str) -> None:
    assert written(ast.parse(source))
