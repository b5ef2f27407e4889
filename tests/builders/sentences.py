"""Sentences of a page in Markdown."""

import re

_NO_PROSE = re.compile(
    r"^(`{3,}|~{3,}|:{3,}).*?^\1[ \t]*$"  # code, directives
    r"|^[ \t]*\|.*?$"  # tables
    r"|<!--.*?-->|^\([\w-]+\)=$",  # comments, targets
    re.MULTILINE | re.DOTALL,
)
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_CODE = re.compile(r"(`+)(?:(?!\1).)+?\1|\$[^$]+\$", re.DOTALL)
# A paragraph ends at an empty line; a heading and an item of a list are paragraphs of their own.
_PARAGRAPH = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*+]|\d+\.)\s|#)|(?<=^)#+\s|\n(?=>)")
_ABBREVIATION = re.compile(r"\b(e\.g|i\.e|etc|vs|approx|Fig|eq|et al|s\.d|cf)\.")
_END = re.compile(r"(?<=[.?!])[)\"'*_]*\s+")
_WORD = re.compile(r"[^\W_]")


def sentences(text):
    """The sentences outside code and tables; code and formulae in a sentence stand for one word each."""
    prose = _NO_PROSE.sub("\n\n", text)
    prose = _LINK.sub(r"\1", _CODE.sub("X", prose))
    for paragraph in _PARAGRAPH.split(prose):
        joined = _ABBREVIATION.sub(lambda found: found[0].replace(".", ""), " ".join(paragraph.split()))
        yield from filter(None, _END.split(joined))


def words(sentence):
    """Its words; a number is one, a sign is none."""
    return [word for word in sentence.split() if _WORD.search(word)]
