"""Equations: numbers that stay, and MathJax in the site itself.

An equation is numbered by its label, "(averaging-3)", so that what cites it goes on to be right when others are added.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.domains.math import MathDomain
from sphinx.util.fileutil import copy_asset_file

PACKAGE, SCRIPT = "sphinx-mathjax-offline", "tex-svg-full.js"  # one file, which loads nothing else


def by_label(app: Sphinx, doctree: nodes.document) -> None:
    """Number the equations of a page by their labels."""
    domain = app.env.domains["math"]
    assert isinstance(domain, MathDomain)
    for node in doctree.findall(nodes.math_block):
        label = node.get("label")
        if label:
            node["number"] = label
            domain.equations[label] = (app.env.docname, label)


def cited(_app: Sphinx, _what: str, _name: str, _thing: Any, _options: Any, lines: list[str]) -> None:
    """Link what a docstring cites as "theory, Eq. (averaging-3)"."""
    label = r"\(([a-z-]+-\d+)\)"
    text = re.sub(
        rf"(theory,\s+)Eqs?\.\s+((?:{label}(?:,\s+|\s+and\s+)?)+)",
        lambda found: found[1] + re.sub(label, r":eq:`\1`", found[2]),
        "\n".join(lines),
    )
    lines[:] = text.split("\n")


def with_script(app: Sphinx, error: Exception | None) -> None:
    """Put MathJax beside the pages, so that they need no network."""
    found = importlib.util.find_spec(PACKAGE)
    assert found is not None
    assert found.origin is not None
    if error is None:
        copy_asset_file(Path(found.origin).parent / "static" / "mathjax" / SCRIPT, Path(app.outdir) / "_static")


def setup(app: Sphinx) -> dict[str, Any]:
    """Say to Sphinx what is here."""
    app.connect("doctree-read", by_label)
    app.connect("autodoc-process-docstring", cited)
    app.connect("build-finished", with_script)
    return {"parallel_read_safe": False}
