"""No sentence of a page is longer than 25 words: many who read these pages read English as a second language."""

import pytest
from builders.pages import ROOT
from builders.sentences import sentences, words

LONGEST = 25
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def too_long(text):
    return [sentence for sentence in sentences(text) if len(words(sentence)) > LONGEST]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short(path):
    assert too_long(path.read_text(encoding="utf-8")) == []


def test_what_is_a_sentence():
    text = "# A head\n\nOne `a b c` is. Two [are here](a.md#b)! At 2.5 m, e.g. here: three?\n- four\n  goes on\n"
    code = "```python\nno. sentence.\n```\n\n| no. | sentence. |\n|---|---|\n| no | none |\n"
    expected = ["A head", "One X is.", "Two are here!", "At 2.5 m, eg here: three?", "- four goes on"]
    assert list(sentences(text + code)) == expected
    assert len(words("- four goes on, 2.5 m - and so on")) == 8


def test_a_long_sentence_is_found():
    assert too_long(f"Short. {'word ' * 26}end. Short.") == [f"{'word ' * 26}end."]
    assert too_long(f"{'word ' * 24}end. Short.") == []
