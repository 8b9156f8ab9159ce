"""The documentation as one site with search: `make docs`."""

from __future__ import annotations

import re
from typing import Any

from umo.system.packages import umo_version

project = "umo"
author = "the umo developers"
version = release = umo_version()
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
root_doc = "index"
exclude_patterns = ["README.md"]
html_theme = "furo"
html_title = f"umo {version}"
html_theme_options = {"source_view_link": ""}
myst_heading_anchors = 4
myst_linkify_fuzzy_links = False
suppress_warnings = ["myst.xref_missing", "myst.header"]
"""Links of a page to files that are no pages, such as tests: they are for readers of the repository."""
default_role = "code"
autodoc_default_options = {"members": True, "imported-members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True


def as_restructured_text(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Docstrings have their examples indented, without a mark before them, and `name: meaning` in lists of names."""
    if what == "module" and any(line.startswith("|-- ") for line in lines):  # the tree of umo.errors
        tree = lines.index("") + 1
        lines[tree:] = [f"    {line}" for line in lines[tree:]]
    found: list[str] = []
    named = False
    for line, following in zip(lines, [*lines[1:], ""], strict=False):
        if line.strip():
            is_name = re.match(r"[a-z_]+: ", line) is not None and (named or following.startswith("    "))
            named = is_name or (named and line.startswith("    "))
            if is_name:
                found.append(f":{line}")
                continue
        begins = line.startswith("    ") and found and not found[-1].strip()
        before = next((each for each in reversed(found) if each.strip()), "")
        if begins and not before.startswith(" ") and not before.endswith("::"):
            found += ["::", ""]
        found.append(line)
    lines[:] = found


ABOVE = re.compile(r"\]\(\.\./(SECURITY|CHANGELOG|CONTRIBUTING)\.md")
"""Links to files of the folder above: on the site, to the pages that include them."""


def lead_to_pages(source: list[str]) -> None:
    source[0] = ABOVE.sub(lambda found: f"]({found[1].lower()}.md", source[0])


def setup(app: Any) -> None:
    app.connect("source-read", lambda app, name, source: lead_to_pages(source))
    app.connect("include-read", lambda app, path, parent, source: lead_to_pages(source))
    app.connect("autodoc-process-docstring", as_restructured_text)
