"""Words of the glossary are linked at their first use on a page, nowhere else."""

import pytest
from builders.pages import DOCS

nodes = pytest.importorskip("docutils.nodes", reason="docutils is not installed (extra docs)")
pytest.importorskip("sphinx", reason="sphinx is not installed (extra docs)")

WORDS = {
    "gaze error": ("term-gaze-error", "An angle."),
    "MPC": ("term-MPC", "A controller."),
    "gaze": ("term-g", "I."),
}


@pytest.fixture
def linked(monkeypatch):
    """Links in a text, as `text -> (target, tooltip)`, and what the text then reads."""
    monkeypatch.syspath_prepend(DOCS / "extensions")
    from glossary_links import _linked

    def parts_of(text):
        parts = _linked(nodes.Text(text), {word.lower(): word for word in WORDS}, WORDS, "glossary.html")
        found = [part for part in parts if isinstance(part, nodes.reference)]
        links = {part.astext(): (part["refuri"], part["reftitle"]) for part in found}
        return links, "".join(part.astext() for part in parts)

    return parts_of


def test_the_first_use_is_linked_and_the_text_stays(linked):
    text = "Gaze errors of the MPC, a gaze error and an mpc."
    links, read = linked(text)
    assert read == text
    assert links == {
        "Gaze errors": ("glossary.html#term-gaze-error", "An angle."),
        "MPC": ("glossary.html#term-MPC", "A controller."),
    }


@pytest.mark.parametrize("text", ["gazempc", "look-gaze", "a/mpc/b", "gaze-x", "MPCx"])
def test_parts_of_words_are_not_linked(linked, text):
    assert linked(text) == ({}, text)
