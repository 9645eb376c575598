"""The derived channels of an image, simulated or measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.arrays import Array
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import is_sign, number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import unquestioned
from phasemap._shared.quantities import Scalar
from phasemap.experiment.control import Control
from phasemap.experiment.described import describe
from phasemap.experiment.lever import DETECTED
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.io.metadata import recorded_microscope, recorded_sign, settings_of_image
from phasemap.results.quantities import CHANNELS, Channel, channel_attributes, motion_seen
from phasemap.results.variables import MODAL, all_variables_of, check_variables, phase_lag, provenance, variables_of

SETTINGS = ("stiffness", "resonance_frequency", "quality_factor", "free_amplitude")
UNCERTAIN = {"phase": "degree", "amplitude": "m", "stiffness": "N/m", "quality_factor": "1", "free_amplitude": "m"}
"""Quantities that may have a standard deviation, and their units."""
ANY_RADIUS = 1e-8  # m, of a tip that no formula asks for


@asked_as()
def channels(
    image: xr.Dataset,
    names: Iterable[str] | None = None,
    *,
    scope: Microscope | None = None,
    setpoint: Scalar | None = None,
    phase_zero: Scalar | None = None,
    sign: int | None = None,
    uncertainty: Mapping[str, Scalar] | None = None,
) -> xr.Dataset:
    """Derive energies and loss tangents from an image.

    Parameters
    ----------
    image : xarray.Dataset
        With ``phase`` [degree], of `phasemap.simulate` or `phasemap.read_image`; ``amplitude`` [m] is used where it is
        there, and the setpoint's where not.
    names : iterable of str, optional
        Which channels, all that the image has by default.
    scope : Microscope, optional
        Lever, drive and frequency; by default what the image's attributes say. Its tip and interaction are not used.
    setpoint : float, optional
        Amplitude over the free amplitude at the drive frequency [1], where the image has no amplitude and does not say.
    phase_zero : float, optional
        Phase that was recorded of the free lever [degree]; by default the image's attribute ``phase_zero``.
    sign : 1 or -1, optional
        -1 if a measured phase counts the lag: if it falls where repulsion grows. By default the image's attribute
        ``phase_sign``, or 1.
    uncertainty : mapping of str to float, optional
        Standard deviations of "phase" [degree], "amplitude", "free_amplitude" [m], "stiffness" [N/m] and
        "quality_factor" [1], taken as independent; the phase of a simulated image has its ``error_phase`` by default.

    Returns
    -------
    xarray.Dataset
        With the dims of `image`, what it has what it takes for, as the page on the file format lists it with formulas:
        ``dissipation``, ``virial`` and other energies; ``loss_tangent`` as instruments compute it; modes one by one.

        ``loss_tangent_corrected``, for adhesion and for how hard the tap is, takes images simulated with
        ``variables=["phase", "contact_storage", "adhesion_loss"]``, or ask `simulate` for the channel itself: amplitude
        and phase alone do not tell it. NaN where there is no contact to speak of.

        Channels of a second mode (``Drive(second=Mode(...))``) take ``mean_gradient``, ``mean_damping``,
        ``sideband_stiffness`` and ``sideband_loss``: ``mode2_frequency_shift`` of AM-FM, ``mode2_amplitude`` and
        ``mode2_phase`` of AM-AM, and ``bimodal_modulus`` by the instrument's formula for a paraboloid on Hertz contact,
        with ``bimodal_modulus_bound``, how far that may be from two modes integrated in time; at most 0.01 is a small
        second mode. Images by the solver "march" have both drives integrated.

        Energies are the orbit's own where the image has them, and else follow from the first harmonic's amplitude and
        phase; the attribute ``derived_from`` says which. With ``error_`` before its name the standard deviation of
        each, where any is known. And ``status``, if there.

    Notes
    -----
    At resonance, with p the phase and a the amplitude over the free one, tan d = (cos p - a) / sin p (Proksch and
    Yablon 2012). Adhesion adds an attraction to the virial, so that it comes out too large, two or three times so on
    soft and sticky materials. So does a hard tap, for it is shorter than that of a sine: without adhesion it comes out
    too large by up to 0.9 times the largest force over k A. Corrected it is omega eta / (2 E*) of a Kelvin-Voigt
    contact within 1 %.

    Examples
    --------
    >>> import phasemap as pm
    >>> surface = pm.Surface(modulus=[[1e9]], adhesion=0.06, viscosity=20.0, pixel_size=4e-9)
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    >>> found = pm.channels(pm.simulate(surface, scope, setpoint=0.6))
    >>> round(float(found.loss_tangent[0, 0]), 4)
    0.0231
    >>> corrected = pm.simulate(surface, scope, setpoint=0.6, variables="loss_tangent_corrected")
    >>> round(float(corrected.loss_tangent_corrected[0, 0]), 4)
    0.0165
    """
    if "phase" not in getattr(image, "data_vars", ()):
        raise InputError("the image", sorted(map(str, getattr(image, "data_vars", ()))), "a Dataset with phase")
    if sign is not None and not is_sign(sign):
        raise InputError("sign", sign, "1 or -1")
    lever, settings = _scope_and_settings(image, scope)
    wanted = _chosen(names, image, lever)
    phase, amplitude = _phase(image, lever, settings, phase_zero, sign), _amplitude(image, lever, settings, setpoint)
    spread = _spread(image, uncertainty)
    data = dict(_derive(wanted, image, lever, amplitude, phase, spread))
    if "status" in image:
        data["status"] = image["status"]
    derived = image.drop_vars(list(image.data_vars)).assign(data)
    asked = {"names": list(data), "sign": sign, "phase_zero": phase_zero, "setpoint": setpoint}
    configuration = {"channels": asked, "microscope": describe(lever)}
    derived.attrs = provenance(configuration, "channels derived")
    if source := image.attrs.get("title") or image.attrs.get("source"):
        derived.attrs["image_source"] = str(source)
    return derived


def _chosen(names: Iterable[str] | None, image: xr.Dataset, scope: Microscope) -> list[Channel]:
    """The channels asked for, or all that the image has; those of modes where there are several."""
    known = {name: channel for name, channel in CHANNELS.items() if _has_mode_of(scope, channel)}
    if names is None:
        several = len(scope.cantilever.eigenmodes) > 1
        by_default = (one for one in known.values() if several or one.mode == 0)
        return [channel for channel in by_default if all(name in image for name in channel.needs)]
    names = (names,) if isinstance(names, str) else tuple(names)
    check_modes_asked(names, scope)
    chosen = [known[name] for name in check_variables(names, tuple(known))]
    for channel in chosen:
        if missing := [name for name in channel.needs if name not in image]:
            allowed = "a channel of which the image has what it needs"
            hint = f'This one needs {" and ".join(missing)}: pm.simulate(..., variables=["{channel.name}"]) has it.'
            raise InputError("channel", channel.name, allowed, hint)
    return chosen


@unquestioned()  # who made the image was told then
def _scope_and_settings(image: xr.Dataset, scope: Microscope | None) -> tuple[Microscope, dict[str, Any]]:
    """Microscope, as far as the formulas need it, and settings of the scan that the image states."""
    settings = settings_of_image(image)
    if scope is not None:
        return scope, settings
    if recorded := recorded_microscope(image.attrs):
        return recorded[0], settings
    missing = [name for name in SETTINGS if name not in settings]
    if missing:
        hint = "Give scope=pm.Microscope(...)."
        raise InputError("what the image says of the scan", Word("without " + " and ".join(missing)), "all of it", hint)
    stiffness, resonance, quality, free = (number(name, settings[name], "", above=0) for name in SETTINGS)
    excitation = "base" if settings.get("detected") == DETECTED["base"] else "direct"
    drive = Drive(free, settings.get("drive_frequency", resonance), excitation)
    scope = Microscope(Cantilever(stiffness, resonance, quality), Tip(ANY_RADIUS), drive)
    at_resonance = free * free / scope.driven_amplitude
    return replace(scope, drive=replace(drive, free_amplitude=at_resonance)), settings


def counted_from(image: xr.Dataset) -> float:
    """Recorded phase where a simulated one is 0 [degree]; NaN of an image that does not say what it was in free air."""
    settings = settings_of_image(image)
    if "phase_zero" not in settings:
        return math.nan
    try:
        free = _scope_and_settings(image, None)[0].free_phase
    except InputError:
        free = 0.0  # of a lever that is not said to be driven beside its resonance
    return float(settings["phase_zero"]) - recorded_sign(settings) * free


def as_lag(image: xr.Dataset) -> xr.Dataset:
    """The image with its lag behind the drive as phase, 90 at free resonance, and attributes that say so.

    The lag counts from any zero where the image does not say its own.
    """
    settings, counted = settings_of_image(image), counted_from(image)
    known, sign = math.isfinite(counted), recorded_sign(settings)
    zero = counted if known else 0.0 if sign == 1 else 90.0
    phase = image["phase"] if (zero, sign) == (0.0, 1) else sign * (image["phase"] - zero)
    free = {"phase_zero": 90.0 - sign * (float(settings["phase_zero"]) - counted)} if known else {}
    return image.assign(phase=phase_lag(phase)).assign_attrs(phase_sign=-1, **free)


def _phase(
    image: xr.Dataset, scope: Microscope, settings: Mapping[str, Any], zero: Scalar | None, sign: int | None
) -> xr.DataArray:
    """The phase [degree], 0 at free resonance, positive repulsive."""
    sign = recorded_sign(settings) if sign is None else sign
    free = scope.free_phase
    recorded = settings.get("phase_zero") if zero is None else number("phase_zero", zero, "degree")
    if recorded is None:
        hint = "Give the phase that was recorded of the free lever, phase_zero=..., or the scope's."
        raise InputError("phase_zero", None, "a number of degrees", hint)
    if sign == 1 and recorded == free:
        return image["phase"]
    return sign * (image["phase"] - recorded) + free


def _amplitude(
    image: xr.Dataset, scope: Microscope, settings: Mapping[str, Any], setpoint: Scalar | None
) -> xr.DataArray:
    """The amplitude that the detector shows [m]."""
    if setpoint is None and "amplitude" in image:
        if (units := image["amplitude"].attrs.get("units", "m")) != "m":
            raise InputError("units of amplitude", units, "m", "Give setpoint=..., which stands for the amplitude.")
        return image["amplitude"]
    held = settings.get("setpoint_amplitude") if setpoint is None else None
    if held is None:
        ratio = settings.get("setpoint") if setpoint is None else setpoint
        if ratio is None:
            raise InputError("setpoint", None, "a number between 0 and 1", "The image has no amplitude.")
        held = number("setpoint", ratio, "1", above=0, below=1) * scope.driven_amplitude
        return (image["phase"] * 0 + held).assign_attrs(over_free=1)
    return image["phase"] * 0 + held


def _spread(image: xr.Dataset, uncertainty: Mapping[str, Scalar] | None) -> dict[str, Any]:
    """Standard deviations of the inputs, of each pixel or of all."""
    spread: dict[str, Any] = {}
    for name, value in (uncertainty or {}).items():
        if name not in UNCERTAIN:
            raise InputError("uncertainty", name, "that of " + " or ".join(UNCERTAIN))
        spread[name] = number(f"uncertainty of {name}", value, UNCERTAIN[name], minimum=0)
    if "phase" not in spread and "error_phase" in image:
        spread["phase"] = image["error_phase"]
    return spread


def _derive(
    wanted: list[Channel], image: xr.Dataset, scope: Microscope, amplitude: xr.DataArray, phase: xr.DataArray,
    spread: dict[str, Any],
) -> Iterator[tuple[str, xr.DataArray]]:  # fmt: skip
    """Yield each channel, and its standard deviation where one is known."""
    used = sorted({name for channel in wanted for name in (*channel.needs, channel.of_orbit) if name in image})
    orbit = {name: image[name] for name in used}
    for channel in wanted:
        needed = {name: orbit[name] for name in (*channel.needs, channel.of_orbit) if name in orbit}
        from_orbit = channel.of_orbit in needed
        attributes = channel_attributes(channel, from_orbit)
        if "status" in image:
            attributes["ancillary_variables"] = "status"
        yield channel.name, _apply(channel, scope, amplitude, phase, needed).assign_attrs(attributes)
        if spread:
            first = {name: values for name, values in needed.items() if name in channel.needs}
            deviation = _deviation(channel, scope, amplitude, phase, first, spread)
            attributes = {"long_name": f"standard deviation of the {channel.long_name}", "units": channel.units}
            yield f"error_{channel.name}", deviation.assign_attrs(attributes)


def _apply(
    channel: Channel, scope: Microscope, amplitude: xr.DataArray, phase: xr.DataArray, orbit: dict[str, xr.DataArray]
) -> xr.DataArray:
    """Values of a channel, from arrays that may be lazy."""

    def channel_of_motion(size: Array, angle: Array, *integrals: Array) -> Array:
        return np.asarray(channel.value(motion_seen(scope, size, angle, dict(zip(orbit, integrals, strict=True)))))

    values: xr.DataArray = xr.apply_ufunc(
        channel_of_motion, amplitude, phase, *orbit.values(), dask="parallelized", output_dtypes=[np.float64]
    )
    return values


def _deviation(
    channel: Channel, scope: Microscope, amplitude: xr.DataArray, phase: xr.DataArray, orbit: dict[str, xr.DataArray],
    spread: dict[str, Any],
) -> xr.DataArray:  # fmt: skip
    """Standard deviation of a channel: half the change by each deviation, up and down, summed in squares."""
    total: Any = 0.0
    for name, width in spread.items():
        ends = []
        for way in (1, -1):
            step = way * width
            stepped = _with_step(scope, name, step)
            size = amplitude + step if name == "amplitude" else amplitude
            if "over_free" in amplitude.attrs:  # what was known is the setpoint
                size = size * (stepped.driven_amplitude / scope.driven_amplitude)
            angle = phase + step if name == "phase" else phase
            ends.append(_apply(channel, stepped, size, angle, orbit))
        total = total + (0.5 * (ends[0] - ends[1])) ** 2
    return total**0.5


@unquestioned()
def _with_step(scope: Microscope, name: str, step: Any) -> Microscope:
    """Microscope with another stiffness, quality factor or free amplitude."""
    if name in ("stiffness", "quality_factor"):
        lever = replace(scope.cantilever, **{name: getattr(scope.cantilever, name) + step})
        # The amplitude of the free lever at resonance is what was measured: the drive follows.
        return replace(scope, cantilever=lever)
    if name == "free_amplitude":
        return replace(scope, drive=replace(scope.drive, free_amplitude=scope.drive.free_amplitude + step))
    return scope


def _has_mode_of(scope: Microscope, channel: Channel) -> bool:
    """True if lever and drive have the mode of a channel."""
    return channel.mode <= len(scope.cantilever.eigenmodes) and (not channel.bimodal or scope.drive.second is not None)


def check_modes_asked(names: object, scope: Microscope) -> None:
    """Refuse names of variables of a mode that the lever does not have, or that its drive leaves alone."""
    count = len(scope.cantilever.eigenmodes)
    for name in (names,) if isinstance(names, str) else names if isinstance(names, Iterable) else ():
        channel = CHANNELS.get(name) if isinstance(name, str) else None
        if name in MODAL[count:] or (channel is not None and channel.mode > count):
            raise InputError("variables", name, f"names of modes up to {count}, for the lever has no more")
        if channel is not None and channel.bimodal and scope.drive.second is None:
            allowed = "a name without a second mode, for the drive has none"
            hint = "Give it one: pm.Drive(..., second=pm.Mode(...)), in a scene [drive.second]."
            raise InputError("variables", name, allowed, hint)


def split(variables: object, control: Control, scope: Microscope) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Variables of an image under this control, and channels, among them by default those of a driven second mode."""
    known = all_variables_of(control)
    more = tuple(
        name
        for name, channel in CHANNELS.items()
        if name not in known and set(channel.needs) <= set(known) and _has_mode_of(scope, channel)
    )
    if variables is None:
        return variables_of(control), tuple(name for name in more if CHANNELS[name].bimodal)
    check_modes_asked(variables, scope)
    names = check_variables(variables, (*known, *more))
    return tuple(name for name in names if name in known), tuple(name for name in names if name in more)


def inputs_of(names: tuple[str, ...], derived: tuple[str, ...], control: Control) -> tuple[str, ...]:
    """Variables that must be known for an image to have these and the derived channels."""
    if not derived:
        return names
    needed = {"phase", "amplitude", *names}
    for name in derived:
        needed |= {*CHANNELS[name].needs, CHANNELS[name].of_orbit}
    return tuple(name for name in all_variables_of(control) if name in needed)


def with_channels(
    image: xr.Dataset, names: tuple[str, ...], derived: tuple[str, ...], control: Control, scope: Microscope
) -> xr.Dataset:
    """The image with derived channels, and without what only they needed; `names` are its variables that stay."""
    if not derived:
        return image
    wanted = [CHANNELS[name] for name in derived]
    found = dict(_derive(wanted, image, scope, image["amplitude"], image["phase"], {}))
    extra = [name for name in all_variables_of(control) if name in image and name not in names]
    return image.drop_vars(extra).assign(found)
