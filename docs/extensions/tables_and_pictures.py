"""Numbers in tables stay on one line; a picture that stands alone shows its description as a caption."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

# Digits, signs, brackets, separators, percent: "-0.06 [-0.09, -0.03]", "1.46 / 1.40", "85 (81 to 88)".
_NUMBERS = re.compile(r"(?=.*\d)([-+−±\d.,/()\[\]% –]| to )+")
# Longer ones, such as lists of settings, may wrap.
_LONGEST = 24


def keep_numbers_together(page: nodes.document) -> None:
    """Mark the cells that hold only numbers; the style sheet keeps these on one line."""
    for cell in page.findall(nodes.entry):
        text = cell.astext()
        if len(text) <= _LONGEST and _NUMBERS.fullmatch(text):
            cell["classes"].append("number")


def add_captions(page: nodes.document) -> None:
    """Make a figure of each paragraph that is one picture."""
    for image in list(page.findall(nodes.image)):
        paragraph = image.parent
        if isinstance(paragraph, nodes.paragraph) and len(paragraph) == 1 and image.get("alt"):
            figure = nodes.figure("", image.deepcopy(), nodes.caption("", image["alt"]))
            page.set_id(figure)  # the caption has a link to itself
            paragraph.replace_self(figure)


def change_page(app: Sphinx, page: nodes.document) -> None:
    """Do both on a page that was read."""
    keep_numbers_together(page)
    add_captions(page)


def setup(app: Sphinx) -> dict[str, bool]:
    """Change each page before its references are resolved."""
    app.connect("doctree-read", change_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
