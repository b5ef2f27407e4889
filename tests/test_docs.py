"""The documentation stays true: its code runs and prints what the pages say, its links lead somewhere."""

import contextlib
import io
import re
import sys
from itertools import pairwise

import pytest
from builders.pages import DOCS, FENCE, PAGES, page

from gazempc.run import main as run_command


def code_blocks(text):
    """Each Python block with its line and, where a text block follows at once, what it must print."""
    fences = [*FENCE.finditer(text), None]
    for fence, after in pairwise(fences):
        if fence[1] != "python":
            continue
        follows = after is not None and after[1] == "text" and not text[fence.end() : after.start()].strip()
        yield text.count("\n", 0, fence.start()) + 1, fence[2], after[2] if follows else None


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A working directory whose modules are forgotten after the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_parts", raising=False)  # of another test, under the pages' name
    yield tmp_path
    for name in [n for n, m in sys.modules.items() if str(getattr(m, "__file__", "")).startswith(str(tmp_path))]:
        del sys.modules[name]


@pytest.mark.parametrize("name", [name for name in PAGES if any(code_blocks(page(name)))])
def test_python_blocks_run_and_print_what_the_page_says(name, own_folder):
    """A block that begins with `# name.py` is a file of that name."""
    namespace = {"__name__": "__main__"}
    for line, code, expected in code_blocks(page(name)):
        if file := re.match(r"# (\w+\.py)\n", code):
            (own_folder / file[1]).write_text(code, encoding="utf-8")
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            # Blank lines put an error at its line in the page.
            exec(compile("\n" * line + code, f"docs/{name}.md", "exec"), namespace)
        if expected is not None:
            assert printed.getvalue().strip() == expected.strip(), f"docs/{name}.md, line {line}"


def test_the_quick_start_shows_what_the_command_prints(own_folder, capsys):
    """All of it but computing times, which differ from run to run."""
    shown = next(body for kind, body in FENCE.findall(page("quickstart")) if body.startswith("subject03_R4: "))
    # As many seeds as a machine without other work takes by default.
    settings = ["--noise-seeds", "8", "--no-figures", "--out", str(own_folder)]
    assert run_command(["--replay", "subject03_R4", *settings]) == 0
    printed = capsys.readouterr().out.splitlines()
    lines = [line for line in shown.splitlines() if line.strip()]
    times = [line for line in lines if "step time" in line or "99 % below" in line]
    assert len(lines) > 15
    assert len(times) == 2
    assert [line for line in lines if line not in times and line not in printed] == []


def test_there_is_code_to_run():
    assert sum(1 for name in PAGES for _ in code_blocks(page(name))) >= 15


def test_every_page_is_in_the_toctree():
    entries = [
        line.strip()
        for kind, body in FENCE.findall(page("index"))
        if kind == "{toctree}"
        for line in body.splitlines()
        if line.strip() and not line.startswith(":")
    ]
    assert sorted(entries) == [name for name in PAGES if name != "index"]


@pytest.mark.parametrize("name", PAGES)
def test_links_between_pages_lead_somewhere(name):
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page(name)):
        assert (DOCS / target).is_file(), target
