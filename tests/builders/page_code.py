"""Code of a page, run from top to bottom as a reader runs it, and what it must print."""

import contextlib
import io
import re
import shlex
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from builders.pages import FENCE
from experiments.console import main as gazempc

_FILE = re.compile(r"# (\w+\.\w+)\n")
_CODE = ("python", "console", "yaml", "toml")


@dataclass(frozen=True)
class Block:
    """Code in a page; `prints` is the text block that follows at once, `file` the name in its first line."""

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
    """Save a file, run Python in the namespace, or run the commands `gazempc`; give what they print."""
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
    """The first line that a page shows and a program did not print, or None; `...` stands for any lines."""
    lines, left_out = iter(printed.strip().splitlines()), False
    for line in shown.strip().splitlines():
        if line == "...":
            left_out = True
        elif (line in lines) if left_out else (next(lines, None) == line):
            left_out = False
        else:
            return line
    return None if left_out else next(lines, None)
