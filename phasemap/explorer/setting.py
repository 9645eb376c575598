"""One position of all sliders: what the page sends, checked and turned into what `phasemap.simulate` takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import number_of
from phasemap._shared.plausible import strict_units, unquestioned
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.explorer.knobs import knobs_of
from phasemap.explorer.limits import check_frequency
from phasemap.explorer.subject import Subject
from phasemap.scenes.objects import microscope_tables
from phasemap.scenes.tables import Table, check_keys, construct
from phasemap.solvers.problem import check_setpoint

BEYOND = 1e4  # times the ends of its slider that a number may be
KEYS = ("setpoint", "free_amplitude", "frequency", "radius", "materials", "pair", "exact")


@dataclass(frozen=True)
class Setting:
    """One position of all sliders."""

    subject: Subject
    scope: Microscope
    setpoint: float
    materials: Mapping[str, Material]
    pair: tuple[str, str]  # the two materials that are compared; twice the same where there is one only
    exact: bool = False  # whether every orbit is exact, or averaged where that is within the accuracy

    @classmethod
    def of(cls, subject: Subject, message: object) -> Setting:
        """Read what the page sends.

        `message`: a dict with setpoint, free_amplitude, frequency (None is the resonance), radius, exact,
            materials (a dict for each) and pair (two numbers of materials); what is missing is as it was to
            begin with.

        Examples
        --------
        >>> from phasemap.explorer.subject import subject_of
        >>> Setting.of(subject_of("samples/step.toml"), {"radius": 20e-9}).scope.tip.radius
        2e-08
        """
        check_keys("the message", message, KEYS)
        assert isinstance(message, dict)
        scope = subject.scope
        drive = {key: _real(message[key]) for key in ("free_amplitude", "frequency") if key in message}
        radius = {"radius": _real(message["radius"])} if "radius" in message else {}
        exact = message.get("exact", False)
        if not isinstance(exact, bool):
            raise InputError("exact", exact, "true or false")
        with strict_units() if subject.strict else unquestioned():  # a slider shows what it is set to
            scope = replace(scope, drive=replace(scope.drive, **drive), tip=replace(scope.tip, **radius))
            check_frequency(scope)
            materials = _materials(subject, message.get("materials"))
            _check_reach(subject, scope, materials)
            return cls(
                subject,
                scope,
                check_setpoint(message.get("setpoint", subject.options["setpoint"])),
                materials,
                _pair(subject, message.get("pair")),
                exact,
            )

    @property
    def solver(self) -> str:
        """Name of the solver for one pixel."""
        return "orbit" if self.exact else "auto"

    @property
    def surface(self) -> Surface:
        """The whole surface."""
        return self._surface(1)

    @property
    def shown(self) -> Surface:
        """The surface as it is solved while a slider moves: with fewer pixels if it has many."""
        return self._surface(self.subject.step)

    def _surface(self, step: int) -> Surface:
        """Every so manieth pixel of the surface."""
        sample = self.subject.sample_under(self.scope.tip)
        relief = sample.topography
        dy, dx = self.subject.pixel_size
        return Surface.from_labels(
            sample.labels[::step, ::step],
            dict(enumerate(self.materials.values())),
            pixel_size=(step * dy, step * dx),
            topography=None if relief is None else relief[::step, ::step],
        )

    def tables(self) -> Table:
        """The tables of the scene that this setting is; the surface's are those of the subject's scene, if any."""
        interaction = self.scope.interaction
        if not isinstance(interaction.contact, str) or interaction.decay_length is None:
            name = "decay_length" if isinstance(interaction.contact, str) else "contact"
            hint = "Copy the Python instead."
            raise InputError(name, getattr(interaction, name), "what a scene file can say", hint)
        scene, options = self.subject.scene, self.subject.options
        kept = {} if scene is None else {name: table for name, table in scene.config.items() if name != "files"}
        solver = "orbit" if self.exact else options["solver"]
        others = kept.get("materials", {})
        tables = {
            **kept,
            "scan": {**kept.get("scan", {}), "setpoint": self.setpoint, "solver": solver},
            "materials": others | {name: asdict(one) for name, one in self.materials.items()},
            **microscope_tables(self.scope),
        }
        kept_tables: Table = without_none(tables)
        return kept_tables


def without_none(value: Any) -> Any:
    """Tables without the keys that TOML could not have."""
    if isinstance(value, Mapping):
        return {key: without_none(one) for key, one in value.items() if one is not None}
    return type(value)(without_none(one) for one in value) if isinstance(value, list | tuple) else value


def _real(value: object) -> Any:
    """A whole number as a float, as JSON does not tell them apart; all else as it is, to be checked."""
    return float(value) if type(value) is int else value


def _materials(subject: Subject, given: object) -> dict[str, Material]:
    """The materials with the values that the page gives."""
    names = list(subject.materials)
    if given is None:
        return dict(subject.materials)
    if not isinstance(given, list) or len(given) != len(names):
        raise InputError("materials", given, f"a list of {len(names)} tables")
    loss = "viscosity" if subject.viscous else "damping"
    made = {}
    for name, values in zip(names, given, strict=True):
        check_keys(name, values, ("modulus", "adhesion", loss))
        real = {  # None is not a value here
            key: number(f"{name} {key}", value, number_of(Material, key).unit) for key, value in values.items()
        }
        made[name] = construct(name, real, lambda base=subject.materials[name], **new: replace(base, **new))
    return made


def _check_reach(subject: Subject, scope: Microscope, materials: Mapping[str, Material]) -> None:
    """Refuse numbers far beyond their sliders: on some of them solvers work without end, and cannot be stopped."""
    every = list(materials.values())
    for knob in knobs_of(subject):
        if knob.key in ("setpoint", "frequency"):
            continue
        holder = scope.tip if knob.key == "radius" else scope.drive if knob.material is None else every[knob.material]
        value = getattr(holder, knob.key)
        if not (value == 0 or knob.low / BEYOND <= value <= knob.high * BEYOND):
            low, high, given = (x / knob.size for x in (knob.low / BEYOND, knob.high * BEYOND, value))
            allowed = f"{low:.4g} to {high:.4g} {knob.unit}".rstrip() + " in the page"
            raise InputError(knob.label, Word(f"{given:.4g} {knob.unit}".rstrip()), allowed)


def _pair(subject: Subject, given: object) -> tuple[str, str]:
    """The names of the two materials that are compared."""
    names = list(subject.materials)
    if given is None:
        return names[0], names[min(1, len(names) - 1)]
    if not isinstance(given, list) or len(given) != 2:
        raise InputError("pair", given, "two numbers of materials")
    first, second = (names[whole("number of a material", number, 0, len(names) - 1)] for number in given)
    return first, second
