"""Positions of all sliders: what the page sends, checked and turned into what `phasemap.simulate` takes.

The sliders and choices of the page are declared in its file ``knobs.json``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import gathered, strict_units
from phasemap.experiment.cantilever import Cantilever
from phasemap.experiment.control import Control, Engage
from phasemap.experiment.described import describe
from phasemap.experiment.interaction import WITH_PARAMETERS, ContactLaw
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import of_one_loss
from phasemap.experiment.microscope import PARTS, Drive, Microscope, Mode
from phasemap.experiment.prony import Prony, spectrum_name
from phasemap.experiment.realism import Realism
from phasemap.experiment.surface import Surface
from phasemap.explorer.limits import check_frequency
from phasemap.explorer.subject import Subject
from phasemap.scenes.objects import control_of, written_microscope
from phasemap.scenes.tables import Table, check_keys, construct, without_none
from phasemap.solvers.continuation.path import Question
from phasemap.solvers.problem import check_setpoint

LOSSES = "materials.*.loss"  # a choice of the page alone: the keys that it shows say the same
GIVEN, WATER = "given", "water"  # what the lever is in: as its numbers say, or in water where they are those in air
FIRST_ALONE = {"free_amplitude": None, "detection": "fm"}  # of a second mode that is not driven


class Knob(NamedTuple):
    """A slider: a number with ends."""

    label: str
    unit: str
    size: float  # of the unit [SI]
    # low, high: ends of the slider [SI]; a number that is typed in may lie beyond
    low: float
    high: float


@cache
def knobs() -> dict[str, Knob]:
    """Sliders with ends of their own, by the key of a scene that each sets; * stands for any material."""
    return {
        one["key"]: Knob(one["label"], one["unit"], one.get("size", 1.0), one["low"], one["high"])
        for one in _declared()
        if "low" in one
    }


def starred(key: str) -> str:
    """The key with * in place of the number of a material."""
    return re.sub(r"^materials\.\d+\.", "materials.*.", key)


def values_of(subject: Subject) -> dict[str, Any]:
    """Values that a subject has in each slider and choice; a law of the user's own by its name."""
    scope, control = subject.scope, describe(subject.options.get("control") or Engage())
    parts = {part: getattr(scope, part) for part in PARTS} | {"scan": subject.options, "control": control}
    parts |= {"realism": subject.realism, "detector": Detector(scope.detector)}
    parts["drive.second"] = scope.drive.second or FIRST_ALONE
    values: dict[str, Any] = {}
    for declared in _declared():
        key, (part, _, name) = declared["key"], declared["key"].rpartition(".")
        if "presets" in declared or key == LOSSES:
            continue
        if part == "materials.*":
            for i, value in enumerate(getattr(material, name) for material in subject.materials.values()):
                values[f"materials.{i}.{name}"] = spectrum_name(value) if isinstance(value, Prony) else value
        elif name == "environment":
            values[key] = GIVEN
        else:
            values[key] = parts[part].get(name) if isinstance(parts[part], Mapping) else getattr(parts[part], name)
    contact, modes = values["interaction.contact"], len(scope.cantilever.eigenmodes)
    law = contact.name if isinstance(contact, ContactLaw) else contact
    return values | {"interaction.contact": law, "cantilever.modes": modes}


@cache
def _declared() -> list[dict[str, Any]]:
    """Sliders and choices that the page's file declares."""
    return json.loads(files("phasemap.explorer").joinpath("page", "knobs.json").read_bytes())


BEYOND = 1e3  # times the ends of its slider that a number may be
KEYS = ("sample", "changes", "names", "pair", "exact", "lag", "quick")
Changes = dict[str, dict[str, Any]]  # by the table of a scene, or the number of a material, and the key


@dataclass(frozen=True)
class Detector:
    """The detector as a table of its own, which it is in a scene."""

    sees: Any


@dataclass(frozen=True)
class Setting:
    """Positions of all sliders."""

    subject: Subject
    scope: Microscope
    setpoint: float
    control: Control
    realism: Realism
    materials: Mapping[str, Material]  # of one loss, by their names in the page
    pair: tuple[str, str]  # the two materials that are compared; twice the same where there is one only
    exact: bool = False  # whether every orbit is exact, or averaged where that is within the accuracy
    lag: bool = False  # whether the phase is counted as the lag behind the drive, 90 degrees for the free lever
    quick: bool = False  # whether averaging will do, which compiles soonest
    warnings: tuple[str, ...] = ()  # of numbers outside all practice
    changes: Mapping[str, Mapping[str, Any]] | None = None  # what differs from the subject

    @classmethod
    def of(cls, subject: Subject, message: object) -> Setting:
        """Read what the page sends.

        `message`: a dict with changes (values by the keys of a scene, where materials have numbers for names), names
            (of the materials), pair (two numbers of materials), exact, lag and quick; what is missing is as it was to
            begin with.
        """
        check_keys("the message", message, KEYS)
        assert isinstance(message, dict)
        switches = {name: message.get(name, False) for name in ("exact", "lag", "quick")}
        for name, on in switches.items():
            if not isinstance(on, bool):
                raise InputError(name, on, "true or false")
        names = _names(subject, message.get("names"))
        changes = _by_table(message.get("changes", {}), len(names))
        with strict_units() if subject.strict else gathered() as warnings:
            parts = {part: _changed(getattr(subject.scope, part), part, changes.get(part, {})) for part in PARTS}
            sees = _changed(Detector(subject.scope.detector), "detector", changes.get("detector", {})).sees
            parts["drive"] = replace(parts["drive"], second=_second(parts["drive"], changes.get("drive.second", {})))
            scope = replace(subject.scope, **parts, detector=sees)
            check_frequency(scope)
            realism = _changed(subject.realism, "realism", changes.get("realism", {}))
            materials = _materials(subject, names, changes)
            _check_reach(changes, scope, list(materials.values()))
        scan = changes.get("scan", {})
        check_keys("scan", scan, ("setpoint",))
        setpoint = check_setpoint(scan.get("setpoint", subject.options["setpoint"]))
        control = _control(subject.options.get("control") or Engage(), changes.get("control", {}))
        one_loss = of_one_loss(materials, scope)
        pair = _pair(names, message.get("pair"))
        told = tuple(dict.fromkeys(warnings or ()))
        return cls(
            subject, scope, setpoint, control, realism, _alike(one_loss), pair, **switches, warnings=told,
            changes=changes,
        )  # fmt: skip

    @property
    def in_water(self) -> bool:
        """True if the page puts the lever in water."""
        return (self.changes or {}).get("cantilever", {}).get("environment") == WATER

    @property
    def only_in_time(self) -> bool:
        """True if some material remembers or is wet, whose motion only the march knows, exactly."""
        return any(Question(one, self.scope).only_in_time for one in self.materials.values())

    @property
    def solver(self) -> str:
        """Name of the solver for one pixel."""
        return "auto" if self.only_in_time else "averaging" if self.quick else "orbit" if self.exact else "auto"

    def counted(self, phase: Any) -> Any:
        """A phase [degree], or many, as the page counts it."""
        return 90.0 - phase if self.lag else phase

    @property
    def options(self) -> dict[str, Any]:
        """Arguments that `phasemap.simulate` takes for the whole image."""
        solver = "orbit" if self.exact and not self.only_in_time else self.subject.options["solver"]
        changed = {"control", "realism"} & set(self.changes or {})
        more = {name: getattr(self, name) for name in changed}
        return {**self.subject.options, **more, "setpoint": self.setpoint, "solver": solver}

    @property
    def surface(self) -> Surface:
        """The whole surface."""
        labels, relief = self.subject.sample_under(self.scope.tip)
        grid, variation = self.subject.pixel_size, self.subject.variation
        materials = list(self.materials.values())
        return Surface.from_labels(labels, materials, pixel_size=grid, topography=relief, variation=variation)

    @property
    def fits_a_scene(self) -> bool:
        """True if a scene file can say its contact law."""
        contact = self.scope.interaction.contact
        return not isinstance(contact, ContactLaw) or type(contact) in WITH_PARAMETERS.values()

    def tables(self) -> Table:
        """The tables of the scene that this setting is; the surface's are those of the subject's scene, if any."""
        if not self.fits_a_scene:
            law = self.scope.interaction.contact
            raise InputError("contact", law, "what a scene file can say", "Copy the Python instead.")
        scene, options = self.subject.scene, self.options
        kept = {} if scene is None else {name: table for name, table in scene.config.items() if name != "files"}
        renamed = dict(zip(self.subject.materials, self.materials, strict=True))
        others = {name: one for name, one in kept.get("materials", {}).items() if name not in renamed}
        if "surface" in kept:
            kept["surface"] = _renamed(kept["surface"], renamed)
        if "control" in kept or options.get("control") is not None:
            kept["control"] = describe(self.control)
        if "realism" in kept or options.get("realism") is not None:
            kept["realism"] = asdict(self.realism)
        tables = {
            **kept,
            "scan": {**kept.get("scan", {}), "setpoint": self.setpoint, "solver": options["solver"]},
            "materials": others | {name: asdict(one) for name, one in self.materials.items()},
            **written_microscope(self.scope),
        }
        if kept.get("drive", {}).get("second") and self.scope.drive.second is None:
            tables["drive"] = tables["drive"] | {"second": "none"}
        return without_none(tables)


def _renamed(table: Table, names: Mapping[str, str]) -> Table:
    """The table of a surface with other names of its materials."""
    used = table.get("materials")
    if isinstance(used, Mapping):
        return {**table, "materials": {label: names.get(name, name) for label, name in used.items()}}
    return {**table, "materials": [names.get(name, name) for name in used or []]}


def _names(subject: Subject, given: object) -> list[str]:
    """The names of the materials in the page."""
    names = list(subject.materials)
    if given is None:
        return names
    others = set(subject.scene.config["materials"]) - set(names) if subject.scene is not None else set()
    wanted = [name for name in given if isinstance(name, str) and name.strip()] if isinstance(given, list) else []
    if len(set(wanted) - others) != len(names) or len(wanted) != len(names) or given != wanted:
        raise InputError("names of the materials", given, f"{len(names)} names that differ")
    return wanted


def _by_table(given: object, materials: int) -> Changes:
    """Changes, key by key, by the tables of the scene that they belong to."""
    if not isinstance(given, dict):
        raise InputError("changes", given, "a table of keys of a scene, such as tip.radius")
    tables: Changes = {}
    for key, value in given.items():
        table, _, name = str(key).rpartition(".")
        tables.setdefault(table, {})[name] = value
    others = ("drive.second", "detector", "scan", "control", "realism")
    check_keys("changes", tables, (*PARTS, *others, *(f"materials.{i}" for i in range(materials))))
    return tables


def _changed(base: Any, name: str, values: dict[str, Any]) -> Any:
    """A part of the microscope with other values; a lever in its environment."""
    if not values:
        return base
    values = dict(values)
    environment = values.pop("environment", GIVEN) if isinstance(base, Cantilever) else GIVEN
    check_keys(name, values, [field.name for field in fields(base)])
    changed = replace(base, **values)
    if environment == GIVEN:
        return changed
    if environment != WATER:
        raise InputError("environment", environment, f"{GIVEN} or {WATER}")
    return changed.in_liquid(modes=len(changed.eigenmodes))


def _second(drive: Drive, values: dict[str, Any]) -> Mode | None:
    """The second mode with other values; one that is not driven has no free amplitude."""
    if not values:
        return drive.second
    check_keys("drive.second", values, FIRST_ALONE)
    merged = {**{name: getattr(drive.second, name, FIRST_ALONE[name]) for name in FIRST_ALONE}, **values}
    return None if merged["free_amplitude"] is None else Mode(**merged)


def _control(base: Control, values: dict[str, Any]) -> Control:
    """The control with other values; one of another kind begins anew."""
    if not values:
        return base
    table = describe(base)
    if (kind := values.get("kind", table["kind"])) != table["kind"]:
        table = {"kind": kind}
    return control_of({**table, **values})


def _materials(subject: Subject, names: list[str], changes: Changes) -> dict[str, Material]:
    """The materials with the values that the page gives."""
    allowed = [field.name for field in fields(Material)]
    made = {}
    for i, (name, base) in enumerate(zip(names, subject.materials.values(), strict=True)):
        values = changes.get(f"materials.{i}", {})
        check_keys(name, values, allowed)
        if isinstance(spectrum := values.get("relaxation"), str):
            values = {**values, "relaxation": Prony.preset(spectrum), "modulus": None}
        made[name] = construct(name, values, lambda base=base, **new: replace(base, **new)) if values else base
    return made


def _alike(materials: Mapping[str, Material]) -> dict[str, Material]:
    """The materials, of one loss, with a viscosity each where one of them has one."""
    if not any(material.viscosity for material in materials.values()):
        return {name: replace(one, viscosity=None) for name, one in materials.items()}
    return {name: replace(one, damping=0.0, viscosity=one.viscosity or 0.0) for name, one in materials.items()}


def _check_reach(changes: Changes, scope: Microscope, materials: list[Material]) -> None:
    """Refuse numbers far beyond their sliders: on some of them solvers work without end, and cannot be stopped."""
    holders = {part: getattr(scope, part) for part in PARTS} | {"drive.second": scope.drive.second}
    for table, values in changes.items():
        holder = materials[int(table[10:])] if table.startswith("materials.") else holders.get(table)
        for name in values:
            knob, value = knobs().get(starred(f"{table}.{name}")), getattr(holder, name, None)
            if knob is None or not value or knob.low / BEYOND <= abs(value) <= knob.high * BEYOND:
                continue
            low, high, given = (f"{x / knob.size:.4g}" for x in (knob.low / BEYOND, knob.high * BEYOND, value))
            unit = f" {knob.unit}".rstrip()
            raise InputError(knob.label, Word(f"{given}{unit}"), f"{low} to {high}{unit} in the page")


def _pair(names: list[str], given: object) -> tuple[str, str]:
    """The names of the two materials that are compared."""
    if given is None:
        return names[0], names[min(1, len(names) - 1)]
    if not isinstance(given, list) or len(given) != 2:
        raise InputError("pair", given, "two numbers of materials")
    first, second = (names[whole("number of a material", number, 0, len(names) - 1)] for number in given)
    return first, second
