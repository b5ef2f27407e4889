"""Sphinx configuration: ``sphinx-build -W -q docs docs/_build/html``; needs no network."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import BaseModel
from sphinx.util.typing import stringify_annotation

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "extensions")]

project = "gazempc"
author = "The gazempc authors"
project_copyright = "2026, The gazempc authors"
release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "gallery",
    "generated_tables",
    "tables_and_pictures",
]
myst_enable_extensions = ["colon_fence"]
# Pages of modules are made by autosummary, as reStructuredText.
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
templates_path = ["_templates"]
exclude_patterns = ["_build"]
default_role = "py:obj"
nitpicky = False

myst_heading_anchors = 3

html_theme = "furo"
html_title = f"gazempc {release}"
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["pages.css"]

# Each page is of one module, which is its title.
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_default_options = {"exclude-members": "model_config"}
autodoc_class_signature = "separated"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "BoolArray", "FloatArray", "StringArray")}
maximum_signature_line_length = 88
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

_INLINE_CODE = re.compile(r"(``.*?``)")


def to_rst(app: object, what: str, name: str, obj: Any, options: object, lines: list[str]) -> None:
    """Make the sources' docstrings, which are plain text with Google sections, valid reStructuredText.

    A bar outside inline code is an absolute value, not a substitution. An indented paragraph of a module's or a class's
    text is an equation and keeps its line breaks. Fields of settings models are listed with types and descriptions.
    """
    out: list[str] = []
    in_equation = False
    for line in lines:
        if what in {"module", "class"} and line.startswith("    ") and (in_equation or not "".join(out[-1:]).strip()):
            if not in_equation and not any(text.rstrip().endswith("::") for text in out[-2:]):
                out += ["::", ""]
            in_equation = True
        elif line.strip():
            in_equation = False
        if in_equation:
            out.append(line)
        else:
            parts = _INLINE_CODE.split(line)
            out.append("".join(part if part.startswith("``") else part.replace("|", r"\|") for part in parts))
    if isinstance(obj, type) and issubclass(obj, BaseModel):
        out.append("")
        types = get_type_hints(obj)  # without pydantic's bounds, which the description states
        for field_name, field in obj.model_fields.items():
            simple = field.default is None or isinstance(field.default, (bool, int, float, str, tuple))
            default = "required" if field.is_required() else f"default ``{field.default!r}``" if simple else ""
            out.append(f":ivar {field_name}: {'; '.join(filter(None, (field.description, default)))}")
            out.append(f":vartype {field_name}: {stringify_annotation(types[field_name], 'smart')}")
    lines[:] = out


def rejoin_property(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Undo that napoleon takes the words before a colon in a property's first line for its type."""
    types = [line for line in lines if line.startswith(":type: ")]
    if what in {"property", "attribute"} and types:
        text = [line for line in lines if line not in types]
        lines[:] = [f"{types[0].removeprefix(':type: ')}: {text[0]}", *text[1:]]


def drop_old_pages(app: object) -> None:
    """Pages of modules that are gone: autosummary makes new pages, and leaves the old ones."""
    folder = ROOT / "docs" / "api"
    listed = " ".join(page.read_text(encoding="utf-8") for page in folder.glob("*.md")).split()
    for page in (folder / "modules").glob("*.rst"):
        if page.stem not in listed:
            page.unlink()


def setup(app: Any) -> None:
    """Register the hooks before and after napoleon's, which has priority 500."""
    app.connect("builder-inited", drop_old_pages, priority=100)  # before autosummary looks
    app.connect("autodoc-process-docstring", to_rst, priority=400)
    app.connect("autodoc-process-docstring", rejoin_property, priority=600)
