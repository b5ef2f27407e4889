"""Size of the project: `python -m benchmarks.size` prints lines of code by folder, modules and words of the pages.

A line of code holds at least one token that is neither a comment nor part of a docstring.
"""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

import tyro

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("gazempc", "experiments", "predictors", "benchmarks", "examples", "tests")
# Threshold of small modules, which are justified only as interfaces.
SMALL_LINES = 40
_NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING,
    tokenize.ENDMARKER,
}  # fmt: skip


def code_lines(source: str) -> int:
    """Lines of code of a module.

    Args:
        source: Source text.

    Returns:
        Number of lines without docstrings, comments and blank lines.
    """
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                lines.difference_update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def sizes(folder: Path) -> dict[Path, int]:
    """Lines of code of the modules in a folder and below, by path; empty if there is no such folder."""
    return {path: code_lines(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.py"))}


def words(folder: Path) -> int:
    """Words of the Markdown pages in a folder and below."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in folder.rglob("*.md"))


def table(root: Path) -> list[str]:
    """Table of a checkout: packages, and folders directly below them.

    Args:
        root: Folder of the checkout.

    Returns:
        Lines of the table; a package's line includes its subfolders.
    """
    rows = [f"{'folder':<30}{'lines':>8}{'modules':>9}{f'< {SMALL_LINES}':>6}"]
    for package in PACKAGES:
        found = sizes(root / package)
        groups = {package: list(found.values())}
        for path, lines in found.items():
            parts = path.relative_to(root).parts
            if len(parts) > 2:
                groups.setdefault("  " + "/".join(parts[:2]), []).append(lines)
        for name, counts in groups.items():
            small = sum(0 < count < SMALL_LINES for count in counts)
            rows.append(f"{name:<30}{sum(counts):>8,}{len(counts):>9}{small:>6}")
    pages = len(list((root / "docs").rglob("*.md")))
    return [*rows, f"{'docs':<30}{words(root / 'docs'):>8,} words on {pages} pages"]


def main(root: Path = ROOT) -> None:
    """Print the table.

    Args:
        root: Folder of the checkout.
    """
    print("\n".join(table(root)))


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.size", description=__doc__)
