"""Tables of results and scenes, written from what the package itself writes and reads files by."""

from __future__ import annotations

import dataclasses
import inspect
import os
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from numpydoc.docscrape import NumpyDocString
from sphinx.application import Sphinx


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table in Markdown."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *([str(cell).replace("|", r"\|") for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def keys(thing: type) -> str:
    """The keys of a scene's table: the fields of a class, with their defaults and what its docstring says of them."""
    said = {one.name: " ".join(one.desc) for one in NumpyDocString(inspect.getdoc(thing) or "")["Parameters"]}
    rows = []
    for field in dataclasses.fields(thing):
        default = "none" if field.default is None else f"`{field.default}`"
        given = "" if field.default is dataclasses.MISSING else default
        rows.append((f"`{field.name}`", given, said[field.name]))
    return table(("key", "default", "what it is"), rows)


def scenes() -> dict[str, str]:
    """Tables of the keys of a scene."""
    import phasemap as pm

    tables: dict[str, type] = {
        "cantilever": pm.Cantilever, "modes": pm.Eigenmode, "tip": pm.Tip, "drive": pm.Drive, "second": pm.Mode,
        "interaction": pm.Interaction,
        "materials": pm.Material, "accuracy": pm.Accuracy, "raster": pm.Raster, "feedback": pm.Feedback,
        "realism": pm.Realism, "tip_change": pm.TipChange, "variation": pm.Variation,
    }  # fmt: skip
    return {f"scene_{name}": keys(thing) for name, thing in tables.items()}


def presets() -> str:
    """Every preset by its kind, as `phasemap presets` lists them."""
    from phasemap.cli.presets import tables

    return "\n".join(f"## {kind.capitalize()}\n\n{table(heads, rows)}" for kind, (heads, *rows) in tables())


def commands() -> str:
    """Usage, arguments and examples of each command, as its parser has them."""
    from phasemap.cli.commands import make_parser

    parsers = next(one.choices for one in make_parser()._actions if isinstance(one.choices, dict))
    os.environ["COLUMNS"] = "78"  # as wide as a page
    pages = []
    for name, one in parsers.items():
        expand = one._get_formatter()._expand_help
        rows = []
        for action in one._actions[1:]:  # but for --help
            words = action.option_strings or [str(action.metavar or action.dest)]
            value = f" {action.metavar or action.dest.upper()}" if action.option_strings and action.nargs != 0 else ""
            rows.append((f"`{', '.join(words)}{value}`", expand(action) if action.help else ""))
        about = str(one.description)
        pages += [f"## phasemap {name}", f"{about[:1].upper()}{about[1:]}.", f"```text\n{one.format_usage()}```"]
        pages += [table(("argument", "what it is"), rows)] * bool(rows)
        for part in str(one.epilog or "").strip().split("\n\n"):
            head, _, lines = part.partition("examples:\n")
            pages.append(f"```bash\n{textwrap.dedent(lines)}\n```" if lines and not head else part)
    return "\n\n".join(pages) + "\n"


def write(app: Sphinx) -> None:
    """Write all tables into docs/generated."""
    from phasemap.results.quantities import CHANNELS
    from phasemap.results.status import Status
    from phasemap.results.variables import FLAGS, FLOATS, IMAGE_VARIABLES, IN_TIME, SCAN_VARIABLES

    def variables(names: Iterable[str]) -> str:
        rows = []
        for name in names:
            if name in FLOATS:
                more = f"; {FLOATS[name].description}" if name in FLOATS and FLOATS[name].description else ""
                rows.append((f"`{name}`", FLOATS[name].units, FLOATS[name].long_name + more))
            else:
                rows.append((f"`{name}`", "flag", FLAGS[name][0]))
        return table(("variable", "unit", "what it is"), rows)

    def flags() -> str:
        rows = [
            (f"`{name}`", ", ".join(f"{value} {word}" for value, word in zip(values, words, strict=True)))
            for name, (_, values, words) in FLAGS.items()
        ]
        return table(("flag", "values"), rows)

    others = [name for name in FLOATS if name not in {*IMAGE_VARIABLES, *SCAN_VARIABLES}]
    written = {
        "image_variables": variables(IMAGE_VARIABLES),
        "scan_variables": variables(SCAN_VARIABLES),
        "orbit_variables": variables(others),
        "channels": table(
            ("variable", "unit", "what it is", "formula"),
            [(f"`{one.name}`", one.units, one.long_name, one.source) for one in CHANNELS.values()],
        ),
        "flags": flags(),
        "statuses": table(("code", "status", "what it means, and what helps"),
                          [(one.code, f"`{one.name}`", one.value) for one in Status]),
        **scenes(),
        "presets": presets(),
        "commands": commands(),
        "in_time": table(("attribute", "text"), [(f"`{name}`", text) for name, text in IN_TIME.items()]),
    }  # fmt: skip
    folder = Path(app.srcdir) / "generated"
    folder.mkdir(exist_ok=True)
    for name, text in written.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Say to Sphinx what is here."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": False}
