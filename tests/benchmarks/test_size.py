"""Lines of code exclude comments, docstrings and blank lines."""

import pytest

from benchmarks.size import code_lines, table


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("# a comment\n\nx = 1  # another\n", 1),
        ('x = """a\nvalue\n"""\n', 3),
        ('def f(\n    a,\n):\n    """Doc."""\n    # why\n    return a\n', 4),
        ('class A:\n    """Doc."""\n\n    def f(self):\n        """Doc\n        of f."""\n', 2),
    ],
)
def test_docstrings_comments_and_blank_lines_are_not_code(source, lines):
    assert code_lines(source) == lines


def test_the_table_counts_folders_small_modules_and_words(tmp_path):
    folder = tmp_path / "gazempc" / "loop"
    folder.mkdir(parents=True)
    (tmp_path / "gazempc" / "__init__.py").write_text('"""Doc."""\n')
    (folder / "a.py").write_text("x = 1\n" * 50)
    (folder / "b.py").write_text("x = 1\n")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text("three words here\n")
    rows = {row.split()[0]: row.split()[1:] for row in table(tmp_path)}
    assert rows["gazempc"] == ["51", "3", "1"]
    assert rows["gazempc/loop"] == ["51", "2", "1"]
    assert rows["docs"][0] == "3"
