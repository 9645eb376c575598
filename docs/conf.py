"""How the site is built: `sphinx-build -W docs docs/_build`, from the root of the repository."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent / "examples")]  # examples share the parameters of a paper

import gallery  # noqa: E402

import phasemap  # noqa: E402

for name in ("generate", "interaction"):
    sys.modules[f"phasemap.{name}"] = getattr(phasemap, name)  # by their public names, which Sphinx imports

project = "phasemap"
author = "phasemap authors"
copyright = author
release = version_of("afm-phasemap")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "equations",
    "gallery",
    "tables",
    "without_server",
]
templates_path = ["_templates"]
exclude_patterns = [
    "_build",
    "_templates",
    "gallery/*.py",
    "gallery/*.ipynb",
    "gallery/sg_execution_times.rst",
    "generated",
]
html_theme = "pydata_sphinx_theme"
html_title = "phasemap"
html_logo = html_favicon = "_static/logo.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {"start": []}  # which has no pages below it
html_theme_options = {
    "logo": {"text": "phasemap"},
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "footer_start": ["copyright"],
    "footer_end": [],
}
copybutton_prompt_text = r">>> |\.\.\. "  # what is copied runs: without prompts and output
copybutton_prompt_is_regexp = True
mathjax_path = "tex-svg-full.js"  # in the site itself: see _ext/equations.py
mathjax3_config = {"svg": {"fontCache": "global"}, "options": {"enableMenu": False}}

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_dmath_allow_labels = True
myst_heading_anchors = 3
suppress_warnings = ["config.cache"]  # the gallery's functions cannot be pickled
math_eqref_format = "Eq. ({number})"

autosummary_generate = ["reference/names.rst"]
autodoc_typehints = "none"  # the docstrings have units and shapes too
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

sphinx_gallery_conf = gallery.CONFIGURATION
