"""Tables of a scene as objects: the microscope and its parts, materials, control and realism.

Each table is checked as a whole, so that everything wrong in it is said at once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap._shared.notices import advise
from phasemap.experiment.beam import Eigenmode
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.interaction import WITH_PARAMETERS, ContactLaw, Interaction
from phasemap.experiment.interaction.longrange import FORCES, LongRange
from phasemap.experiment.interaction.table import Table as ForceTable
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Mode, Tip
from phasemap.experiment.realism import IN_TIME, TYPICAL_SCAN, Realism, TipChange, check_realism
from phasemap.scenes.tables import Complaints, Table, check_keys, construct, missing, without_none

T = TypeVar("T")

CONTROLS: dict[str, type[Control]] = {"engage": Engage, "raster": Raster, "feedback": Feedback}
LOW_Q = 50.0  # below this it matters what the detector sees


def scan_of(table: Table) -> tuple[float, Table]:
    """The setpoint, and the table with its defaults."""
    from phasemap.solvers.problem import check_setpoint
    from phasemap.solvers.solver import SOLVERS

    scan = {"solver": "auto", **table}
    check_keys("[scan]", scan, ("setpoint", "solver", "strict_units"), ("setpoint",))
    complaints = Complaints()
    setpoint = complaints.of(construct, "[scan]", {"setpoint": scan["setpoint"]}, check_setpoint)
    complaints.of(check_choice, "[scan] solver", scan["solver"], [solver.name for solver in SOLVERS])
    complaints.make()
    assert setpoint is not None
    return setpoint, scan


def microscope_of(tables: Table, folder: Path = Path()) -> Microscope:
    """The microscope of the tables for its parts; files that they name are relative to `folder`."""
    complaints = Complaints()
    lever, tip = complaints.of(_cantilever, tables), complaints.of(object_of, tables, "tip", Tip)
    drive, interaction = complaints.of(_drive, tables), complaints.of(_interaction, tables, folder)
    detector = {"sees": "slope", **table_of(tables, "detector")}
    complaints.of(check_keys, "[detector]", detector, ("sees",))
    complaints.make()
    assert isinstance(lever, Cantilever) and isinstance(tip, Tip)
    assert isinstance(drive, Drive) and isinstance(interaction, Interaction)
    if lever.quality_factor < LOW_Q and "excitation" not in table_of(tables, "drive"):
        advise(
            f"Q is {lever.quality_factor:g} and [drive] does not say excitation: set it to 'base' for a shaker under "
            "the lever, by which phases change by degrees, or to 'direct' for a force on the tip."
        )
    if lever.quality_factor < LOW_Q and (names := _dry_presets(tables)):
        advise(
            f"Q is {lever.quality_factor:g}, as in liquid, and the adhesion of {', '.join(names)} is that of a preset "
            f"for dry air: in a liquid it is mostly far smaller. Set materials.{names[0]}.adhesion."
        )
    try:
        scope = Microscope(lever, tip, drive, interaction, detector["sees"])
    except InputError as error:
        name = "[detector] sees" if error.name == "detector" else error.name
        raise InputError(name, error.value, error.allowed, error.hint) from error
    if scope.advice:
        advise(scope.advice)
    return scope


def microscope_tables(scope: Microscope) -> Table:
    """The tables of which `microscope_of` makes the same."""
    table = dataclasses.asdict(scope)
    return {**table, "interaction": interaction_table(scope.interaction), "detector": {"sees": scope.detector}}


def written_microscope(scope: Microscope) -> Table:
    """The same tables as a file has them, without what is None."""
    tables = microscope_tables(scope)
    tables["interaction"]["decay_length"] = scope.interaction.decay_length or "none"
    found: Table = without_none(tables)
    return found


def _cantilever(tables: Table) -> Cantilever:
    """The lever, which may have higher modes, and be in a liquid."""
    table = table_of(tables, "cantilever")
    if "liquid" in table:
        name = "[cantilever.liquid]"
        check_keys(name, table["liquid"], ("density", "viscosity", "modes", "liquid_pulls"))
        in_air = _cantilever({"cantilever": {key: value for key, value in table.items() if key != "liquid"}})
        return construct(name, table["liquid"], in_air.in_liquid)
    if isinstance(modes := table.get("modes"), (list, tuple)):
        made = [_from_table(f"[[cantilever.modes]] {i}", mode, Eigenmode) for i, mode in enumerate(modes, 2)]
        table = {**table, "modes": made}
    return _from_table("[cantilever]", table, Cantilever)


def _drive(tables: Table) -> Drive:
    """The drive, which may have a second mode."""
    table = table_of(tables, "drive")
    if (second := table.get("second")) is not None:
        made = None if second == "none" else _from_table("[drive.second]", second, Mode)
        table = {**table, "second": made}
    return _from_table("[drive]", table, Drive)


def _interaction(tables: Table, folder: Path) -> Interaction:
    """The interaction, whose contact and long-range force may be laws with parameters."""
    table = table_of(tables, "interaction")
    if isinstance(table.get("longrange"), str) and table["longrange"] in FORCES:
        # Parameters of a long-range force that is only named may stand beside its name.
        fields = {field.name for field in dataclasses.fields(FORCES[table["longrange"]])}
        beside = {key: value for key, value in table.items() if key in fields}
        table = {key: value for key, value in table.items() if key not in fields}
        table["longrange"] = {"law": table["longrange"], **beside}
    for key, laws in (("contact", WITH_PARAMETERS), ("longrange", FORCES)):
        if isinstance(given := table.get(key), dict):
            name = f"[interaction.{key}]"
            if "law" not in given:
                raise missing(name, "law")
            check_choice(f"{name} law", given["law"], laws)
            parameters = {field: value for field, value in given.items() if field != "law"}
            if given["law"] == ForceTable.name and set(parameters) == {"file"}:
                if not isinstance(parameters["file"], str) or not parameters["file"]:
                    raise InputError(f"{name} file", parameters["file"], "a file name")
                made: Any = ForceTable.read(folder / parameters["file"])
            else:
                made = _from_table(name, parameters, laws[given["law"]])
            table = {**table, key: made}
    return _from_table("[interaction]", table, Interaction)


def interaction_table(interaction: Interaction) -> Table:
    """The table of which `_interaction` makes the same."""
    table = dataclasses.asdict(interaction)
    for key in ("contact", "longrange"):
        if isinstance(law := getattr(interaction, key), (ContactLaw, LongRange)):
            table[key] = {"law": law.name, **table[key]}
    return table


def with_typical(tables: Table) -> Table:
    """The tables of a scene with what its preset of the realism asks for besides, where the scene does not say it."""
    realism = table_of(tables, "realism")
    if "preset" not in realism:
        return tables
    construct("[realism]", {"name": realism["preset"]}, Realism.preset)  # refuses one that is none
    control = table_of(tables, "control")
    if control.get("kind", "feedback") == "feedback":
        control = {"kind": "feedback", **TYPICAL_SCAN, **control}
    else:
        realism = {**dict.fromkeys(IN_TIME, "none"), **realism}
    surface = tables["surface"]
    if isinstance(surface, dict):
        surface = {"seen_by_tip": True, **surface}
    return {**tables, "realism": realism, "control": control, "surface": surface}


def realism_of(table: Table, control: Control | None, lines: int | None) -> Realism:
    """The realism of its table, which has one of its own for a change of the tip."""
    if "tip_change" in table:
        table = {**table, "tip_change": _from_table("[realism.tip_change]", table["tip_change"], TipChange)}
    realism = _from_table("[realism]", table, Realism)
    if control is None or lines is None:
        return realism
    return construct("[realism]", {"realism": realism}, check_realism, control=control, lines=lines)


def control_of(table: Table) -> Control:
    """The control of its kind; a key of another kind is told from a misspelt one."""
    check_choice("[control] kind", table["kind"], CONTROLS)
    kind, table = table["kind"], {key: value for key, value in table.items() if key != "kind"}
    keys = {name: {field.name for field in dataclasses.fields(cls)} for name, cls in CONTROLS.items()}  # type: ignore[arg-type]
    for key, value in table.items():
        others = [name for name in CONTROLS if key in keys[name]]
        if others and kind not in others:
            belongs = f"It belongs to kind = {' or '.join(map(repr, others))}."
            raise InputError(f"[control] {key}", value, f"nothing where kind is {kind!r}", belongs)
    return _from_table("[control]", table, CONTROLS[kind])


def _dry_presets(tables: Table) -> list[str]:
    """Names of the materials that have their adhesion from a preset."""
    materials = {name: table for name, table in table_of(tables, "materials").items() if isinstance(table, dict)}
    return [name for name, table in materials.items() if "preset" in table and "adhesion" not in table]


def materials_of(tables: Table) -> dict[str, Material]:
    """The materials by name."""
    complaints = Complaints()
    materials = {
        name: complaints.of(_from_table, f"[materials.{name}]", table, Material)
        for name, table in table_of(tables, "materials").items()
    }
    complaints.make()
    return {name: material for name, material in materials.items() if material is not None}


def object_of(tables: Table, name: str, cls: type[T]) -> T:
    """The object of the table that has its name."""
    return _from_table(f"[{name}]", table_of(tables, name), cls)


def table_of(tables: Table, name: str) -> Table:
    """A table of the scene, empty where it is not given."""
    table = tables.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"[{name}]", table, "a table")
    return table


def _from_table(name: str, table: object, cls: type[T]) -> T:
    """A frozen dataclass from the table of its fields, or from a preset and what differs from it."""
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]
    required = [field.name for field in fields if field.default is dataclasses.MISSING]
    if cls is Material and not (isinstance(table, Mapping) and "relaxation" in table):
        required.append("modulus")
    allowed = [field.name for field in fields]
    if (preset := getattr(cls, "preset", None)) is not None:
        allowed.append("preset")
        if isinstance(table, dict) and "preset" in table:
            _check_table(name, table, cls, allowed)
            others = {key: value for key, value in table.items() if key != "preset"}
            return construct(name, others, partial[T](preset, table["preset"]))
    _check_table(name, table, cls, allowed, required)
    assert isinstance(table, dict)
    return construct(name, table, cls)


def _check_table(name: str, table: object, cls: type, allowed: list[str], required: Iterable[str] = ()) -> None:
    """Refuse keys that are unknown or missing, and numbers that are not allowed, all at once."""
    complaints = Complaints()
    complaints.of(check_keys, name, table, allowed, required)
    for key, value in table.items() if isinstance(table, dict) else ():
        if isinstance(field := vars(cls).get(key), Number):
            complaints.of(construct, name, {"value": value}, field.check)
    complaints.make()
