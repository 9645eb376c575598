"""The site's sources: numbered equations and what cites them, and the list of public names."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from types import ModuleType

import phasemap

ROOT = Path(__file__).parent.parent
THEORY = {path.stem: path.read_text() for path in sorted((ROOT / "docs" / "theory").glob("*.md"))}
LABELS = {page: re.findall(r"^\$\$ \((\S+)\)$", text, re.MULTILINE) for page, text in THEORY.items()}
CITED = r"theory,\s+Eqs?\.\s+((?:\([a-z-]+-\d+\)(?:,\s+|\s+and\s+)?)+)"


def test_equations_are_numbered_by_their_page_in_order() -> None:
    for page, labels in LABELS.items():
        assert labels == [f"{page}-{n}" for n in range(1, len(labels) + 1)]


def test_every_equation_that_the_code_cites_is_in_the_theory() -> None:
    known = {label for labels in LABELS.values() for label in labels}
    text = "\n".join(path.read_text() for path in sorted((ROOT / "phasemap").rglob("*.py")))
    citations = re.findall(CITED, text)
    assert len(citations) == len(re.findall(r"theory,\s+Eq", text)) > 0  # none is written in another way
    cited = {label for one in citations for label in re.findall(r"\(([a-z-]+-\d+)\)", one)}
    assert cited <= known
    assert set(re.findall(rf"\(((?:{'|'.join(THEORY)})-\d+)\)", text)) == cited  # and none without "theory, Eq."


def test_the_reference_has_every_public_name() -> None:
    names = []
    for name in phasemap.__all__:
        thing = getattr(phasemap, name)
        names += [f"{name}.{one}" for one in thing.__all__] if isinstance(thing, ModuleType) else [name]
    listed = re.findall(r"^   (\w[\w.]*)$", (ROOT / "docs" / "reference" / "names.rst").read_text(), re.MULTILINE)
    again = {"interaction.ContactLaw", "interaction.Interaction"}  # public at the top too
    assert Counter(listed) == Counter(set(names) - again)


def test_every_tutorial_has_a_picture_and_every_picture_that_a_page_names_is_there() -> None:
    pages = [path for path in (ROOT / "docs").rglob("*.md") if not {"_build", "generated"} & set(path.parts)]
    shown = {
        path: re.findall(r"!\[[^\]]+\]\(([^)\s]+\.png)\)", path.read_text()) for path in [*pages, ROOT / "README.md"]
    }
    for path, pictures in shown.items():
        assert all((path.parent / picture).is_file() for picture in pictures), path
    assert all(shown[path] for path in (ROOT / "docs" / "tutorials").glob("*.md") if path.stem != "index")


def test_the_methods_of_a_law_that_the_page_lists_are_there() -> None:
    page = (ROOT / "docs" / "howto" / "law.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?) \|", page, re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`(\w+)", row)]
    assert len(listed) > 8 and [name for name in listed if not hasattr(phasemap.ContactLaw, name)] == []
