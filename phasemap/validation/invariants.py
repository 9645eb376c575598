"""What must hold in every image, whatever the sample: its layout, and in every pixel relations that ask no solver.

A periodic orbit obeys theory, Eqs. (energy-2) and (energy-4). The image has all that is in them but the higher
harmonics; what these leave in the balance of energy must fit what they leave in that of the virial.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap._shared.pixels import centres
from phasemap.experiment.lever import lever_of, lost_in_air, of_tip, offset_and_factor, supplied
from phasemap.experiment.realism import DIGITISED
from phasemap.experiment.surface import Surface
from phasemap.imaging.engaged import stiffening
from phasemap.imaging.feedback.lines import mean_ground
from phasemap.results.channels import channels
from phasemap.results.quantities import CHANNELS, is_derived
from phasemap.results.variables import FLAGS, FLOATS, all_variables_of
from phasemap.validation.claims import Claims
from phasemap.validation.picture import FAILS, HOLDS, MEAN, Claim, Picture, judged, pixels_in_words

RISING = "position from the top of the image"  # what y is called in earlier images, and only there

SAME_FORMULA = 1e-9  # of a channel that is computed from the same numbers again
ROUNDING = 1e-8  # of what is compared; the solvers iterate until little less is left
LEAST = 1e-9, 1e-20  # [degree, m] of errors: phase and height are not computed to more than twelve digits
OF_ORBITS = ("error_phase", "error_height", "energy_closure")  # what only a periodic orbit has
CLOSES = 1e-6  # energy closure of an exact orbit, as the tests assert it


def layout(image: xr.Dataset, claims: Claims) -> Claim:
    """Judge the layout; nothing else can be looked at where it fails."""
    wrong = list(_wrong(image, claims))
    found = "; ".join(wrong[:3]) if wrong else f"{len(image.data_vars)} variables"
    pixels = int(np.prod([image.sizes[dim] for dim in _dims(claims) if dim in image.sizes]))
    return Claim("dims, coordinates, units, flags are as agreed", FAILS if wrong else HOLDS, pixels, found)


def _dims(claims: Claims) -> tuple[str, ...]:
    return ("direction", "y", "x") if claims.control.directions else ("y", "x")


def _wrong(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    """Say what is not as agreed."""
    dims, known = _dims(claims), all_variables_of(claims.control)
    sizes = dict(zip(("y", "x"), claims.shape, strict=True), direction=len(claims.control.directions))
    for dim in dims:
        if image.sizes.get(dim) != sizes[dim]:
            yield f"there are {image.sizes.get(dim, 0)} along {dim}, not {sizes[dim]}"
    yield from _wrong_coordinates(image, claims)
    if "status" not in image:
        yield "there is no status"
    for name in map(str, image.data_vars):
        variable = image[name]
        about = FLOATS.get(name) or CHANNELS.get(name)
        if name not in known and name not in CHANNELS:
            yield f"{name} is not a variable of such an image"
        elif variable.dims != dims:
            yield f"{name} has dims {variable.dims}, not {dims}"
        elif name in FLAGS:
            yield from _wrong_flags(name, variable)
        elif variable.dtype.kind != "f" or about is None or not _says(variable, "units", about.units):
            unit = None if about is None else about.units
            yield f"{name} is {variable.dtype} in {variable.attrs.get('units')!r}, not numbers in {unit!r}"


def _wrong_coordinates(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    for dim, count, step in zip(("y", "x"), claims.shape, claims.pixel_size, strict=True):
        if dim not in image.coords:
            yield f"there is no coordinate {dim}"
        elif image.sizes.get(dim) == count:
            places = _from_the_corner(image[dim])
            if places.dtype.kind not in "fiu" or not np.allclose(places, centres(count, step), rtol=1e-9, atol=0):
                yield f"{dim} is not at the centres of pixels of {step:g} m"
    names = list(claims.control.directions)
    if names and ("direction" not in image.coords or list(image["direction"].values) != names):
        yield f"direction is not {', '.join(names)}"


def _wrong_flags(name: str, variable: xr.DataArray) -> Iterator[str]:
    _, values, meanings = FLAGS[name]
    said = np.atleast_1d(variable.attrs.get("flag_values", ()))
    if said.tolist() != list(values) or not _says(variable, "flag_meanings", " ".join(meanings)):
        yield f"the flags of {name} have other values or meanings"
    elif variable.dtype.kind not in "iu" or not np.isin(variable.values, values).all():
        yield f"{name} has values that are none of its flags"


def _says(variable: xr.DataArray, name: str, text: str) -> bool:
    """Whether an attribute is this text: it may be an array, too."""
    said = variable.attrs.get(name)
    return isinstance(said, str) and said == text


def _from_the_corner(places: xr.DataArray) -> NDArray[Any]:
    """Places along x or y as they rise from the top left corner."""
    falls = places.dims == ("y",) and not _says(places, "long_name", RISING)
    values: NDArray[Any] = places.values
    return values[::-1] if falls else values


def invariants(picture: Picture, surface: Surface) -> Iterator[Claim]:
    """Judge what all pixels claim. `surface`: as it passed under the tip, drift and all."""
    yield _numbers(picture)
    if picture.claims.realism.bits is not None:
        yield _digits(picture)
    if picture.has("height", "tip_offset"):
        yield _height(picture, surface)
    if picture.claims.control.in_time:
        if picture.has("amplitude", "amplitude_error"):
            yield _amplitude_error(picture)
    else:
        if "amplitude" in picture:
            yield _amplitude(picture)
        if picture.has("phase", "amplitude", "dissipation", "virial", "mean_deflection"):
            yield _balances(picture)
        if "energy_closure" in picture:
            yield _closure(picture)
        if picture.claims.solver != "averaging" and picture.has("error_phase", "error_height", "solver"):
            yield _errors(picture)
    if (claim := _follows(picture)) is not None:
        yield claim
    if picture.has("motion", "amplitude_spread", "phase_spread"):
        yield _motion(picture)
    if picture.has("branch", "phase", "amplitude"):
        yield _branch(picture)
    if not picture.claims.control.directions:
        yield _one_material(picture, surface)


def _numbers(picture: Picture) -> Claim:
    """Numbers where there is a solution, NaN and no branch elsewhere."""
    solved, wrong = picture.solved, np.zeros(picture.shape, bool)
    for name in picture.floats():
        without = name.startswith("error_") and picture.claims.solver == "averaging"
        if not without:
            missing = np.isfinite(picture.raw(name).astype(np.float64)) != solved
            wrong |= missing & ~(picture.irregular & (name in OF_ORBITS))
    for name in FLAGS.keys() - {"status", "solver"}:
        if name in picture:
            wrong |= (picture.raw(name) >= 0) != solved
    failed = int(np.count_nonzero(~picture.good))
    found = "every pixel is solved" if not failed else f"{failed} without a solution"
    return judged("numbers where solved, none elsewhere", picture, wrong, wrong, np.ones(picture.shape, bool), found)


def _digits(picture: Picture) -> Claim:
    """Channels that an instrument records take no values between those of its converter."""
    apart, allowed = np.zeros(picture.shape), np.zeros(picture.shape)
    for name in filter(picture.__contains__, DIGITISED):
        values, step = picture.raw(name), 2 * picture.coarse(name)
        if step > 0:
            digits = (values - np.nanmin(values)) / step
            apart = np.fmax(apart, np.abs(digits - np.rint(digits)))
            allowed = np.fmax(allowed, 1e-3 + 1e-15 * np.abs(values) / step)
    found = f"{picture.claims.realism.bits} bits"
    return judged("values are quantised", picture, apart > allowed, apart, picture.solved, found)


def _height(picture: Picture, surface: Surface) -> Claim:
    """Height is topography + tip offset - amplitude; of a scan, over the mean ground of each pixel."""
    relief = np.zeros(surface.shape) if surface.topography is None else surface.topography
    amplitude: Array | float = picture.claims.amplitude
    if picture.claims.control.in_time:
        relief = np.array([mean_ground(line) for line in relief])
    elif "amplitude" in picture:
        amplitude = picture["amplitude"]
    apart = np.abs(picture["height"] - (relief + picture["tip_offset"] - amplitude))
    size = np.abs(relief) + np.abs(picture["tip_offset"]) + np.abs(amplitude)
    bad = ~(apart <= 1e-12 * size + picture.coarse("height") + picture.coarse("amplitude"))
    return judged("height is topography + tip offset - amplitude", picture, bad, apart, picture.solved, _metres(apart))


def _amplitude(picture: Picture) -> Claim:
    """The amplitude is that of the setpoint."""
    wanted = picture.claims.amplitude
    apart = np.abs(picture["amplitude"] - wanted)
    # The mean of an irregular motion is found as far as its spread allows.
    bad = ~(apart <= ROUNDING * wanted + picture.coarse("amplitude") + MEAN * picture.spread("amplitude"))
    found = f"setpoint {picture.claims.setpoint:g} of {picture.claims.microscope.driven_amplitude * 1e9:.4g} nm"
    return judged("the amplitude is that of the setpoint", picture, bad, apart, picture.good, found)


def _of_tip(picture: Picture) -> tuple[Array, Array]:
    """Amplitude and phase of the tip [m, rad]."""
    return of_tip(lever_of(picture.claims.microscope), picture["amplitude"], np.radians(picture["phase"]))


def _magnified(picture: Picture) -> Array:
    """At most by how much an error of what the detector sees is larger in the motion of the tip."""
    lever = lever_of(picture.claims.microscope)
    offset = np.abs(offset_and_factor(lever)[0])
    return np.asarray((1 + offset / picture["amplitude"]) ** 2)


def _amplitude_error(picture: Picture) -> Claim:
    """What the controller left is the amplitude less the setpoint's."""
    wanted = picture.claims.amplitude
    apart = np.abs(picture["amplitude"] - wanted - picture["amplitude_error"])
    coarse = picture.coarse("amplitude") + picture.coarse("amplitude_error")
    bad = ~(apart <= ROUNDING * wanted + coarse)
    about = "amplitude error is amplitude minus setpoint"
    return judged(about, picture, bad, apart, picture.solved, _metres(apart))


def _balances(picture: Picture) -> Claim:
    """Energy and virial leave room for the same higher harmonics, and for no less than none."""
    lever = lever_of(picture.claims.microscope)
    stiffness, drive = lever[col.STIFFNESS], lever[col.DRIVE]
    (amplitude, phase), mean = _of_tip(picture), picture["mean_deflection"]
    unknown = picture.unknown_phase() * _magnified(picture)
    given, air = supplied(lever, amplitude, phase), lost_in_air(lever, amplitude)
    # With one mode both are sums over harmonics, of n^2 A_n^2 and of (n^2 omega^2 - 1) A_n^2, over A^2; with more the
    # first is still positive.
    power = (given - picture["dissipation"] - air) / air
    elastic = (
        2 * (mean / amplitude) ** 2 + lever[col.DYNAMIC_STIFFNESS] - drive / amplitude * np.sin(phase)
        - 2 * picture["virial"] / (stiffness * amplitude**2)
    )  # fmt: skip
    closure = np.abs(np.nan_to_num(picture["energy_closure"])) if "energy_closure" in picture else 0.0
    full = np.pi * stiffness * drive * amplitude
    harmonic = picture.raw("solver") == col.INTERPOLATED if "solver" in picture else False
    stated = np.where(harmonic, 0.0, closure * np.abs(given))  # there, what the harmonics take is in the closure
    more = unknown + ROUNDING + picture.coarse("amplitude") / amplitude
    power_unknown = (stated + 2 * full * more) / air
    elastic_unknown = 4 * drive / amplitude * more + 4 * np.abs(mean) / amplitude**2 * picture.claims.accuracy.height
    omega, several = lever[col.OMEGA], lever[col.MODES] > 1
    below, above = (omega**2 - 0.25) * power - elastic, elastic - omega**2 * power
    doubt = elastic_unknown + omega**2 * power_unknown
    excess = np.maximum(-np.inf if several else np.maximum(below, above) - doubt, -power - power_unknown)
    found = f"higher harmonics take up to {100 * _largest(power * air / given, picture.good):.2g} % of the energy"
    about = "energy and virial balance with the phase"
    # The sums are those of a period: motion that has none loses energy beside its harmonics, too.
    return judged(about, picture, ~(excess <= 0), excess / doubt, picture.good & ~picture.irregular, found)


def _closure(picture: Picture) -> Claim:
    """Energy closes, as the drive's largest work sees it: off resonance most comes back within the cycle."""
    closure = np.abs(picture["energy_closure"])
    if picture.has("phase", "solver"):
        phase = _of_tip(picture)[1] if "amplitude" in picture else np.radians(picture["phase"])
        closure = closure * np.abs(np.cos(phase))
        known = picture.good & (picture.raw("solver") != col.INTERPOLATED)  # that of interpolated has harmonics in it
    else:
        known = picture.good
    known = known & ~picture.irregular
    bad = ~(closure <= CLOSES + picture.unknown_phase())
    found = (
        f"to within {_largest(np.abs(picture['energy_closure']), known):.2g} of the energy in" if known.any() else ""
    )
    return judged("energy out is energy in", picture, bad, closure, known, found)


def _errors(picture: Picture) -> Claim:
    """What the solvers estimate is within the accuracy asked for, and more than rounding leaves to any solver."""
    accuracy = picture.claims.accuracy
    phase, height = picture["error_phase"], picture["error_height"]
    bad = ~((phase <= accuracy.phase) & (height <= accuracy.height) & (phase >= LEAST[0]) & (height >= LEAST[1]))
    largest = _largest(phase, picture.good), _largest(height, picture.good)
    found = f"up to {largest[0]:.2g} degree and {largest[1] * 1e12:.2g} pm"
    about = f"estimated errors within {accuracy.phase:g} degree and {accuracy.height * 1e12:g} pm"
    return judged(about, picture, bad, phase / accuracy.phase, picture.good & ~picture.irregular, found)


def _follows(picture: Picture) -> Claim | None:
    """Judge whether channels are what their formulas make of the image's other variables; None without such."""
    made = [
        name
        for name, channel in CHANNELS.items()
        if name in picture
        and is_derived(name)
        and picture.has("phase", *channel.needs, *filter(None, [channel.of_orbit]))
    ]
    if not made:
        return None
    again = channels(picture.image, made, scope=picture.claims.microscope)
    bad, share = np.zeros(picture.shape, bool), np.zeros(picture.shape)
    for name in made:
        value, claimed = again[name].values.reshape(picture.shape), picture.raw(name)
        bad |= ~np.isclose(claimed, value, rtol=SAME_FORMULA, atol=0, equal_nan=True)
        share = np.fmax(share, np.abs(np.nan_to_num(claimed - value)))
    about = "derived channels follow from the other variables"
    return judged(about, picture, bad, share, picture.good, ", ".join(made))


def _motion(picture: Picture) -> Claim:
    """Motion that is not periodic has a spread, and no other has."""
    phase, amplitude = picture.raw("phase_spread"), picture.raw("amplitude_spread")
    spread = (phase >= 0) & (amplitude > 0)
    bad = np.where(picture.irregular, ~spread, ~((phase == 0) & (amplitude == 0)))
    found = f"irregular in {pixels_in_words(int(np.count_nonzero(picture.irregular)))}"
    if picture.irregular.any():
        found += f", phase spread up to {_largest(phase, picture.good):.2g} degree"
    return judged("motion goes with its spread", picture, bad, picture.irregular, picture.solved, found)


def _branch(picture: Picture) -> Claim:
    """The branch is the sign of what the surface adds to the lever's stiffness, which the phase says."""
    scope, amplitude = picture.claims.microscope, picture["amplitude"]
    added = stiffening(scope, amplitude, np.radians(picture["phase"]))
    bad = (added > 0) != (picture.raw("branch") == 1)
    doubt = scope.base_amplitude / amplitude * (picture.unknown_phase() + ROUNDING) * _magnified(picture)
    bad &= np.abs(added) > doubt + picture.coarse("amplitude") / amplitude
    repulsive = (picture.raw("branch") == 1)[picture.solved]
    found = f"repulsive in {100 * repulsive.mean():.3g} %" if repulsive.size else ""
    return judged("branch goes with phase", picture, bad, np.abs(added), picture.solved, found)


def _one_material(picture: Picture, surface: Surface) -> Claim:
    """Pixels of one material, under one tip, show the same."""
    _, numbers = surface.unique()
    change = picture.claims.realism.tip_change
    changed = np.arange(surface.shape[0])[:, np.newaxis] >= (surface.shape[0] if change is None else change.line)
    kinds = (2 * numbers.astype(np.int64) + changed).reshape(-1)
    count = np.bincount(kinds)
    shared = np.flatnonzero(count[kinds] > 1)  # by several pixels
    bad = np.zeros(kinds.size, np.int64)
    for name in map(str, picture.image.data_vars) if len(shared) else ():
        if name != "height":  # that has the relief in it, and is compared with the tip offset
            values = picture[name].astype(np.float64).reshape(-1)[shared]
            usual = _usual(values, kinds[shared])
            apart = np.abs(values - usual)
            same = (apart <= 1e-9 * np.abs(usual) + 2 * picture.coarse(name)) | (np.isnan(values) & np.isnan(usual))
            bad[shared] += ~same
    looked_at = np.zeros(kinds.size, bool)
    looked_at[shared] = True
    wrong, of = bad.reshape(picture.shape), looked_at.reshape(picture.shape)
    found = f"{np.count_nonzero(count)} materials"
    return judged("pixels of one material show the same", picture, wrong > 0, wrong, of, found)


def _usual(values: Array, kinds: NDArray[np.int64]) -> Array:
    """The value of the middle one of the pixels of each kind, for every pixel: one that was changed does not show."""
    order = np.lexsort((values, kinds))
    _, first, inverse, count = np.unique(kinds[order], return_index=True, return_inverse=True, return_counts=True)
    usual = np.empty(values.size)
    usual[order] = values[order][first + (count - 1) // 2][inverse]
    return usual


def _largest(values: Array, of: NDArray[np.bool_]) -> float:
    """The largest number among these pixels, 0 if there is none."""
    known = values[of & np.isfinite(values)]
    return float(known.max()) if known.size else 0.0


def _metres(values: Array) -> str:
    known = values[np.isfinite(values)]
    return f"to within {1e12 * (float(known.max()) if known.size else 0.0):.2g} pm"
