"""The documentation: its code runs and prints the shown output, its links resolve."""

import contextlib
import io
import re
import shlex
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
from builders.pages import DOCS, FENCE, PAGES, TUTORIALS, page

from experiments.console import main as gazempc
from gazempc.run import main as run_command

_FILE = re.compile(r"# (\w+\.\w+)\n")
_CODE = ("python", "console", "yaml", "toml")


@dataclass(frozen=True)
class Block:
    """Code in a page; `prints` is the text block directly after it, `file` the name in its first line."""

    line: int
    language: str
    code: str
    prints: str | None

    @property
    def file(self):
        found = _FILE.match(self.code)
        return found and found[1]


def code_blocks(text):
    """The blocks of a page."""
    fences = [*FENCE.finditer(text), None]
    for fence, after in pairwise(fences):
        if fence[1] in _CODE:
            follows = after is not None and after[1] == "text" and not text[fence.end() : after.start()].strip()
            yield Block(text.count("\n", 0, fence.start()) + 1, fence[1], fence[2], after[2] if follows else None)


def run_block(block, page, namespace):
    """Save a file, run Python in the namespace, or run the commands `gazempc`; returns the output."""
    if block.file:
        Path(block.file).write_text(block.code, encoding="utf-8")
        return ""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        if block.language == "python":
            # Blank lines put an error at its line in the page.
            exec(compile("\n" * block.line + block.code, page, "exec"), namespace)
        for command in re.findall(r"^\$ gazempc (.*)$", block.code, re.MULTILINE):
            with contextlib.redirect_stderr(printed):
                gazempc(shlex.split(command))
    lines = [line.rstrip() for line in printed.getvalue().splitlines()]
    return "\n".join(line for line in lines if not line.startswith("... "))  # progress


def not_printed(shown, printed):
    """The first line of a page that a program did not print, or None; `...` matches any lines."""
    lines, left_out = iter(printed.strip().splitlines()), False
    for line in shown.strip().splitlines():
        if line == "...":
            left_out = True
        elif (line in lines) if left_out else (next(lines, None) == line):
            left_out = False
        else:
            return line
    return None if left_out else next(lines, None)


WITH_PYTHON = [name for name in PAGES if "python" in {block.language for block in code_blocks(page(name))}]


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A working directory whose modules are unloaded after the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("my_parts", "my_gaze", "my_tracker", "my_robot"):  # of another test, under the pages' name
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield tmp_path
    for name in [n for n, m in sys.modules.items() if str(getattr(m, "__file__", "")).startswith(str(tmp_path))]:
        del sys.modules[name]


def run_page(name, languages):
    """Run the blocks of these languages in order; each must print the output on the page."""
    namespace = {"__name__": "__main__"}
    for block in code_blocks(page(name)):
        if block.language in languages:
            printed = run_block(block, f"docs/{name}.md", namespace)
            if block.prints is not None:
                assert not_printed(block.prints, printed) is None, f"docs/{name}.md, line {block.line}:\n{printed}"


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_PYTHON)
def test_python_blocks_run_and_print_the_output_on_the_page(name, own_folder, in_this_process):
    """A block that begins with `# name.py` is a file of that name."""
    run_page(name, {"python"})


@pytest.mark.slow
@pytest.mark.parametrize("name", TUTORIALS)
def test_tutorials_run_and_print_their_shown_output(name, own_folder, in_this_process):
    """Shell commands included."""
    run_page(name, {"python", "console", "yaml", "toml"})


def test_ellipses_match_any_lines_of_a_printout():
    printed = "a\nb\nc\nd\n"
    for shown in ("a\nb\nc\nd", "...\nb\n...", "a\n...", "...\nd", "a\n...\nc\nd", "..."):
        assert not_printed(shown, printed) is None, shown
    for shown, wrong in (("b\n...", "b"), ("...\nc\nb", "b"), ("a\nb\nc", "d"), ("...\ne\n...", "e"), ("...\nc", "d")):
        assert not_printed(shown, printed) == wrong, shown


@pytest.mark.slow
def test_the_quick_start_shows_the_output_of_the_command(own_folder, capsys):
    """All but computing times, which are not reproducible."""
    shown = next(body for kind, body in FENCE.findall(page("quickstart")) if body.startswith("subject03_R4: "))
    settings = ["--noise-seeds", "3", "--no-figures", "--out", str(own_folder)]
    assert run_command(["--replay", "subject03_R4", *settings]) == 0
    printed = capsys.readouterr().out.splitlines()
    lines = [line for line in shown.splitlines() if line.strip()]
    times = [line for line in lines if "step time" in line or "99 % below" in line]
    assert len(lines) > 15
    assert len(times) == 2
    assert [line for line in lines if line not in times and line not in printed] == []


def test_every_page_is_in_the_toctree():
    entries = [
        line.strip()
        for kind, body in FENCE.findall(page("index"))
        if kind == "{toctree}"
        for line in body.splitlines()
        if line.strip() and not line.startswith(":")
    ]
    assert sorted(entries) == [name for name in PAGES if name != "index"]


@pytest.mark.parametrize("name", [*PAGES, *TUTORIALS])
def test_links_between_pages_resolve(name):
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page(name)):
        assert ((DOCS / name).parent / target).is_file(), target


def test_every_tutorial_is_on_the_page_of_tutorials():
    assert sorted(re.findall(r"^tutorials/\w+$", page("tutorials"), re.MULTILINE)) == TUTORIALS
