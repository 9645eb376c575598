"""Numbers with units: the same as plain numbers in SI units, everywhere a number is."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phasemap as pm
from phasemap._shared.fields import Number
from phasemap._shared.quantities import KINDS, NotThatUnit, array_in_si, in_si
from phasemap.experiment import generate
from phasemap.experiment.interaction import FlatPunch, MaugisDugdale, Neck

CLASSES = (
    pm.Material, pm.Cantilever, pm.Tip, pm.Drive, pm.Interaction, pm.Accuracy, pm.Feedback, pm.Realism, pm.TipChange,
    FlatPunch, MaugisDugdale, Neck, pm.Mode, pm.Eigenmode,
)  # fmt: skip
BESIDE = {  # what else a constructor needs
    pm.Material: {"modulus": 1e9}, pm.Drive: {"free_amplitude": 20e-9}, pm.Tip: {"radius": 10e-9},
    pm.Cantilever: {"stiffness": 40.0, "resonance_frequency": 3e5, "quality_factor": 400.0},
    pm.Eigenmode: {"frequency_ratio": 6.3, "quality_factor": 400.0},
    pm.TipChange: {"line": 3, "radius": 1e-8}, Neck: {"length": 1e-9}, pm.Feedback: {},
}  # fmt: skip
WRITTEN = {  # a number that a field of this unit can have, with a unit, and in SI
    "m": ("2.1 nm", 2.1e-9), "Pa": ("3 GPa", 3e9), "J/m2": ("50 mJ/m^2", 0.05), "N/m": ("40 mN/mm", 40.0),
    "Hz": ("7.5 kHz", 7.5e3), "Pa s": ("500 mPa s", 0.5), "V": ("-20 mV", -0.02), "K": ("25 degC", 298.15),
    "degree": ("0.5 degrees", 0.5), "s": ("20 us", 20e-6), "1/s": ("500 Hz", 500.0),
    "m/sqrt(Hz)": ("20 fm/sqrt(Hz)", 20e-15), "1": ("45 %", 0.45),
}  # fmt: skip
OF_LEVER = {"length": ("120 um", 120e-6), "width": ("30 um", 30e-6)}
OF_QUALITY = {"quality_factor": ("400", 400.0), "frequency_ratio": ("6.3", 6.3)}  # above 0.5, and 1
UNITS = pint.UnitRegistry()


def numbers_of(cls: type) -> list[str]:
    return [name for name, value in vars(cls).items() if isinstance(value, Number)]


FIELDS = [(cls, name) for cls in CLASSES for name in numbers_of(cls)]


def made(cls: Any, name: str, value: Any) -> Any:
    arguments = {**BESIDE.get(cls, {}), name: value}
    gains = {"proportional_gain", "integral_gain"}
    if name in gains:
        arguments = dict.fromkeys(gains, 1.0) | arguments
    relaxes = {"relaxed_modulus": 1e9, "relaxation_time": 1e-7}
    if name in relaxes:
        arguments = {**relaxes, "modulus": 5e9} | {key: arguments[key] for key in arguments if key != "modulus"}
    return cls(**arguments)


@pytest.mark.parametrize(("cls", "name"), FIELDS, ids=lambda one: getattr(one, "__name__", one))
def test_every_constructor_that_takes_a_number_takes_its_text_and_its_quantity(cls: Any, name: str) -> None:
    text, plain = OF_QUALITY.get(name) or (cls is pm.Cantilever and OF_LEVER.get(name)) or WRITTEN[vars(cls)[name].unit]
    wanted = made(cls, name, plain)
    assert made(cls, name, text) == wanted
    magnitude, unit = text.split(" ", 1) if " " in text else (text, "")
    if unit not in ("fm/sqrt(Hz)", "%"):
        assert made(cls, name, UNITS.Quantity(float(magnitude), unit)) == wanted
    assert type(getattr(made(cls, name, text), name)) is float


@pytest.mark.parametrize(("cls", "name"), FIELDS, ids=lambda one: getattr(one, "__name__", one))
def test_another_dimension_is_refused_in_one_sentence_with_an_example(cls: Any, name: str) -> None:
    unit = vars(cls)[name].unit
    wrong = "3 kHz" if unit not in ("Hz", "1/s") else "3 nm"
    with pytest.raises(pm.InputError, match=rf"{name} is '{wrong}'; allowed: [^.]*(\.\d[^.]*)*\.$") as caught:
        made(cls, name, wrong)
    if unit != "1":
        assert str(caught.value).endswith(f"such as {KINDS[unit][1]!r}.")


def test_every_number_of_a_value_object_declares_what_it_measures() -> None:
    for cls in CLASSES:
        plain = [
            field.name for field in dataclasses.fields(cls)
            if "float" in str(field.type) and not str(field.type).startswith(("Number", "tuple"))
        ]  # fmt: skip
        assert not plain, cls


PREFIXED = {"nm": 1e-9, "um": 1e-6, "pm": 1e-12, "mm": 1e-3, "km": 1e3, "Gm": 1e9}


# Decimal numbers, so that no digit is lost: what is typed is what Python reads without the unit.
@given(st.integers(-(10**15), 10**15), st.integers(-12, 6), st.sampled_from(sorted(PREFIXED)))
def test_text_with_a_unit_is_the_nearest_float(digits: int, exponent: int, unit: str) -> None:
    plain = float(f"{digits}e{exponent + round(np.log10(PREFIXED[unit]))}")
    assert in_si(f"{digits}e{exponent} {unit}", "m") == plain
    assert in_si(UNITS.Quantity(float(f"{digits}e{exponent}"), unit), "m") == pytest.approx(plain, rel=1e-15, abs=0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.sampled_from(sorted(PREFIXED)))
def test_an_array_with_a_unit_is_rounded_once(values: list[float], unit: str) -> None:
    found = array_in_si(UNITS.Quantity(np.array(values), unit), "m")
    assert np.array_equal(found, np.array([float(f"{v!r}") for v in values]) * PREFIXED[unit]) or np.allclose(
        found, np.array(values) * PREFIXED[unit], rtol=3e-16, atol=0
    )


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("5 rad/s", "Hz"), ("60 rpm", "Hz"), ("3 deg", "1"), ("0.1", "degree"), ("40", "m"), ("40e-9", "m"),
        ("nm", "m"), ("", "m"), ("nan nm", "m"), ("40 NM", "m"), ("9**9**9**9 m", "m"), ("1 m^99", "m"),
        ("40 nm" + " " * 99, "m"), ("__import__('os') m", "m"), ("1_0 nm", "m"), ("50 mJ", "J/m2"), ("4 nm 3", "m"),
    ],
)  # fmt: skip
def test_what_is_no_number_with_this_unit_is_refused(text: str, unit: str) -> None:
    with pytest.raises(NotThatUnit):
        in_si(text, unit)


@pytest.mark.parametrize(
    "text", ["50 mJ/m^2", "50mJ/m2", "50 mJ/m²", "50 mJ m-2", "50 mJ m⁻²", "5e-2 J/m**2", "50 mN/m"]
)
def test_units_may_be_written_in_any_usual_way(text: str) -> None:
    assert in_si(text, "J/m2") == 0.05


@pytest.mark.parametrize("value", ["a Dataset", "an array"])
def test_what_is_no_number_is_not_taken_for_none(value: str) -> None:
    import xarray as xr

    given: Any = xr.Dataset({"none": ("x", [1.0])}) if value == "a Dataset" else np.array(["none", "none"])
    field = Number[float | None]("m", None, said="height")
    assert field.check(None) is None and field.check("none") is None
    with pytest.raises(pm.InputError, match="height is "):
        field.check(given)
    for make in (
        lambda: pm.Material(1e9, viscosity=given),
        lambda: pm.Tip(10e-9, modulus=given),
        lambda: pm.Drive(20e-9, frequency=given),
        lambda: pm.Interaction(decay_length=given),
        lambda: pm.Realism(temperature=given),
    ):
        with pytest.raises(pm.InputError):
            make()


def test_a_surface_takes_maps_and_lists_with_units() -> None:
    wanted = pm.Surface([[1e9, 3e9]], [[0.05, 0.06]], topography=[[0.0, 1.5e-9]], pixel_size=(4e-9, 2e-9))
    maps = np.array([[1.0, 3.0]]) * UNITS.GPa, np.array([[50.0, 60.0]]) * UNITS.mJ / UNITS.m**2
    relief, sides = np.array([[0.0, 1.5]]) * UNITS.nm, np.array([4.0, 2.0]) * UNITS.nm
    assert pm.Surface(*maps, topography=relief, pixel_size=sides) == wanted
    lists = [["1 GPa", "3 GPa"]], [["50 mJ/m2", 0.06]]
    assert pm.Surface(*lists, topography=[["0 nm", "1.5 nm"]], pixel_size=("4 nm", 2e-9)) == wanted


def test_a_surface_believes_the_units_and_dims_of_a_data_array() -> None:
    import xarray as xr

    modulus = xr.DataArray([[1.0, 2.0, 3.0]] * 2, dims=("y", "x"), attrs={"units": "GPa"})
    surface = pm.Surface(modulus.transpose("x", "y"), pixel_size="4 nm")
    assert surface == pm.Surface(1e9 * modulus.values, pixel_size=4e-9)
    with pytest.raises(pm.InputError, match="units of modulus is 'nm'; allowed: Pa, or another unit of the same kind"):
        pm.Surface(modulus.assign_attrs(units="nm"), pixel_size="4 nm")
    with pytest.raises(pm.InputError, match="coordinate y is not monotonic"):
        pm.Surface(modulus.assign_coords(y=[1.0, 1.0]), pixel_size="4 nm")


GENERATED: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "stripes": ({"period": 16e-9, "angle": 30}, {"period": "16 nm", "angle": "30 degrees"}),
    "checkerboard": ({"side": 8e-9}, {"side": "8 nm"}),
    "step": ({"position": 9e-9}, {"position": "90 angstrom"}),
    "particles": ({"radius": 6e-9, "area_fraction": 0.2}, {"radius": "6 nm", "area_fraction": "20 %"}),
    "lamellae": ({"period": 28e-9, "annealing": 1}, {"period": "0.028 um", "annealing": 1}),
    "blend": ({"spacing": 30e-9}, {"spacing": "30 nm"}),
    "roughness": ({"rms": 0.5e-9, "correlation_length": 9e-9}, {"rms": "500 pm", "correlation_length": "9 nm"}),
}


@pytest.mark.parametrize("name", [name for name in generate.__all__ if name != "gradient"])
def test_every_generator_takes_lengths_with_units(name: str) -> None:
    plain, written = GENERATED[name]
    make = getattr(generate, name)
    assert np.array_equal(make((32, 32), 2e-9, **plain), make((32, 32), "2 nm", **written))


def test_a_gradient_may_be_of_any_unit() -> None:
    assert np.array_equal(generate.gradient((1, 3), start="1 GPa", stop="3 GPa"), [[1e9, 2e9, 3e9]])
    assert np.array_equal(generate.gradient((1, 3), start="0 degrees", stop="90 degrees"), [[0, 45, 90]])


SCENE = Path(__file__).parents[2] / "samples/step.toml"


def test_a_scene_in_text_is_the_scene_in_numbers() -> None:
    plain = [
        "drive.free_amplitude=35e-9",
        "tip.radius=12e-9",
        "materials.stiff.modulus=2.5e9",
        "surface.pixel_size=4e-9",
    ]
    written = [
        "drive.free_amplitude=35 nm",
        "tip.radius=12nm",
        "materials.stiff.modulus=2.5 GPa",
        'surface.pixel_size="4 nm"',
    ]
    a, b = pm.load_scene(SCENE, plain), pm.load_scene(SCENE, written)
    assert (a.surface, a.microscope, a.options) == (b.surface, b.microscope, b.options)
    with pytest.raises(pm.InputError, match=r"\[drive\] free_amplitude is '35 kHz'; .* a length such as '40 nm'\."):
        pm.load_scene(SCENE, ["drive.free_amplitude=35 kHz"])


def test_what_is_switched_off_by_none_is_so_in_a_scene() -> None:
    scene = pm.load_scene(SCENE, ["interaction.decay_length=none", "interaction.contact=jkr"])
    assert scene.microscope.interaction == pm.Interaction("jkr", decay_length=None)
    with pytest.raises(pm.InputError, match=r"radius is 'none'; allowed: a finite number"):
        pm.Tip("none")


@pytest.mark.slow
def test_importing_and_plain_numbers_do_without_pint() -> None:
    code = (
        "import sys, phasemap as pm; pm.load_scene('samples/step.toml'); assert 'pint' not in sys.modules;"
        "pm.Drive('40 nm'); assert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], cwd=SCENE.parents[1], check=True)
