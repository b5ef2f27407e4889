"""Links each word of the glossary where a page first uses it; its meaning is the link's tooltip."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

GLOSSARY = "glossary"
_NOT_THERE = {GLOSSARY, "changelog"}
# No link in a heading, in code, in a link.
_NOT_IN = (nodes.title, nodes.literal, nodes.literal_block, nodes.reference, nodes.caption, nodes.term, nodes.rubric)


def meanings(glossary: nodes.document) -> dict[str, tuple[str, str]]:
    """What the page of the glossary says.

    Args:
        glossary: That page.

    Returns:
        Word -> target in the page, meaning.
    """
    found = {}
    for item in glossary.findall(nodes.definition_list_item):
        term, meaning = item.children
        found[term.astext()] = (term["ids"][0], meaning.astext())
    return found


def link_words(app: Sphinx, page: nodes.document, name: str) -> None:
    """Link the first use of each word in the text of a page."""
    if name in _NOT_THERE or app.builder.format != "html":
        return
    words = meanings(app.env.get_doctree(GLOSSARY))
    left = {word.lower(): word for word in words}
    uri = app.builder.get_relative_uri(name, GLOSSARY)
    for text in list(page.findall(nodes.Text)):
        if left and not _is_in(text, _NOT_IN) and _is_in(text, (nodes.paragraph,)):
            text.parent.replace(text, _linked(text, left, words, uri))


def _linked(text: nodes.Text, left: dict[str, str], words: dict[str, tuple[str, str]], uri: str) -> list[nodes.Node]:
    """The text with links to words; those words are no longer left."""
    longest_first = "|".join(re.escape(word) for word in sorted(words, key=len, reverse=True))
    parts: list[nodes.Node] = []
    end, whole = 0, text.astext()
    for found in re.finditer(rf"(?<![\w`/-])({longest_first})s?(?![\w-])", whole, re.IGNORECASE):
        if found[1].lower() not in left:
            continue
        target, meaning = words[left.pop(found[1].lower())]
        link = nodes.reference("", found[0], refuri=f"{uri}#{target}", internal=True, reftitle=meaning)
        link["classes"].append("glossary-word")
        parts += [nodes.Text(whole[end : found.start()]), link]
        end = found.end()
    return [*parts, nodes.Text(whole[end:])]


def _is_in(node: Any, kinds: tuple[type, ...]) -> bool:
    while node.parent is not None:
        node = node.parent
        if isinstance(node, kinds):
            return True
    return False


def setup(app: Sphinx) -> dict[str, bool]:
    """Link after all references are known."""
    app.connect("doctree-resolved", link_words)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
