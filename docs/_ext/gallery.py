"""The gallery: each script in `examples` runs once, and its page shows its text, its picture and what it said."""

from __future__ import annotations

import builtins
import re
import shutil
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from sphinx.application import Sphinx
from sphinx_gallery.scrapers import figure_rst

from phasemap import ResultWarning

EXAMPLES = Path(__file__).parents[2] / "examples"
WARNINGS = ExitStack()  # as they are outside the scripts


def picture(_block: Any, variables: dict[str, Any], conf: dict[str, Any]) -> str:
    """Take the picture that a script has written, whichever way it was drawn."""
    script = Path(variables["src_file"])
    written = script.with_suffix(".png")
    if not written.exists():
        return ""
    path = next(variables["image_path_iterator"])
    shutil.move(written, path)
    return figure_rst([path], conf["src_dir"])


def tidy(_conf: dict[str, Any], script: str, when: str) -> None:
    """Run each script as the tests do, with the same warnings as errors, and leave nothing of it behind."""
    name = Path(script).stem
    if when == "before":
        mpl.use("agg")
        WARNINGS.enter_context(warnings.catch_warnings())
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ResultWarning)  # what a measured file does not say
        builtins.__file__ = str(EXAMPLES / f"{name}.py")  # which the gallery withholds
        return
    plt.close("all")
    WARNINGS.close()
    for left in EXAMPLES.glob(f"{name}.*"):
        if left.is_dir():
            shutil.rmtree(left)
        elif left.suffix != ".py":
            left.unlink()


def place(script: str) -> int:
    """Show the scripts of a section in the order in which the gallery's page lists them."""
    return (EXAMPLES.parent / "docs" / "examples.rst").read_text().find(f"/{Path(script).name}\n")


def titled(_app: Sphinx, name: str, source: list[str]) -> None:
    """Make a heading of the question with which a script begins."""
    if re.match(r"gallery/(?!index|sg_)", name):
        source[0] = re.sub(r"(\.py:\n\n)([^\n]+)\n", _heading, source[0], count=1)


def _heading(found: re.Match[str]) -> str:
    return f"{found[1]}{found[2]}\n{'=' * len(found[2])}\n"


CONFIGURATION = {
    "examples_dirs": str(EXAMPLES),
    "gallery_dirs": "gallery",
    "backreferences_dir": "generated/backreferences",
    "doc_module": ("phasemap",),
    "filename_pattern": r".*",
    "image_scrapers": (picture,),
    "reset_modules": (tidy,),
    "reset_modules_order": "both",
    "within_subsection_order": "FileNameSortKey",
    "minigallery_sort_order": place,
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "notebook_extensions": set(),
    "write_computation_times": False,
}


def setup(app: Sphinx) -> dict[str, Any]:
    """Say to Sphinx what is here."""
    app.connect("source-read", titled)
    return {"parallel_read_safe": False}
