"""Answers to the page: the image, the curves, and the map of the contrast, each at one setting.

A drag needs one orbit for each material; whole images, curves and contrasts come from the public functions
`phasemap.simulate`, `sweep_distance` and `contrast`.
"""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.errors import InputError
from phasemap._shared.notices import untold
from phasemap._shared.units import say
from phasemap.experiment.cantilever import Cantilever
from phasemap.experiment.described import describe
from phasemap.experiment.lever import of_tip
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import film_of, rows_of
from phasemap.explorer.limits import accuracy_of, far_off
from phasemap.explorer.setting import Setting
from phasemap.results.descriptions import FORCES, describe_failures, describe_validity
from phasemap.results.explanation import LAG, PHASE, PointMotion, lines_of, shown_number
from phasemap.results.quantities import CHANNELS, OF_SECOND, OF_SECOND_MODE, TipMotion
from phasemap.results.status import Status
from phasemap.results.variables import FLOATS, branch_of, motion_of, word_of
from phasemap.scenes.scene import scene_from_tables
from phasemap.scenes.surface import seen_by_tip
from phasemap.solvers.continuation.path import Question
from phasemap.solvers.integrals import widened
from phasemap.solvers.pixel import solve_pixel
from phasemap.solvers.problem import Work, forces_of, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name
from phasemap.sweeps.contrasts.contrast_map import contrast
from phasemap.sweeps.contrasts.pair import BISTABLE, regimes
from phasemap.sweeps.sweep import sweep_distance

VARIABLES = (
    "height", "phase", "tip_offset", "indentation", "mean_deflection", "dissipation", "virial", "branch", "motion",
    "status", "solver",
)  # fmt: skip
POINTS, SAMPLES = 48, 192  # of a curve, and of a period
DEEPEST, HIGHEST = 0.15, 1.12  # tip offsets of a curve, over the free amplitude
BEYOND = 6e-9  # m above the free amplitude from where the tip is attracted
SETPOINTS = np.linspace(0.3, 0.96, 18)
AMPLITUDES = np.geomspace(0.4, 2.5, 13)  # of the map, over the one in its middle
INFINITE = (math.inf, -math.inf)
SAME = 1.0  # degrees between the orbit that engaging finds and the same on a curve


class DrawnImage(NamedTuple):
    """An image as the page draws it."""

    about: dict[str, Any]  # everything but the maps, as JSON has it
    # height, phase: float32, shape (ny, nx) [nm] above the lowest point, and [degree]; NaN where a pixel has no
    # solution
    height: NDArray[np.float32]
    phase: NDArray[np.float32]


def picture(setting: Setting) -> DrawnImage:
    """Answer a drag: the image of every pixel engaged from far, and what each material does."""
    step = setting.subject.step
    labels, relief = setting.subject.sample_under(setting.scope.tip)
    labels = np.ascontiguousarray(labels[::step, ::step])
    work, ds = _solved(setting)
    shown = set(np.unique(labels).tolist())
    known = [0] * len(work) if setting.quick else regimes(work, accuracy_of(setting.scope).periods)
    described = {
        name: _found(setting, name, ds, i, bool(known[i] == BISTABLE)) if i in shown else None
        for i, name in enumerate(setting.materials)
    }
    first, second = (described[name] for name in setting.pair)
    about = {
        "materials": [None if one is None else _plain(one, setting) for one in described.values()],
        "why": lines_of(first, second, LAG if setting.lag else PHASE) if first and second else [],
        "free_amplitude": setting.scope.driven_amplitude,
        "lever": lever_in_water(setting.scope.cantilever) if setting.in_water else "",
        "step": step,
        "shape": list(labels.shape),
        "pixel": [step * side for side in setting.subject.pixel_size],
    }
    height = ds["height"].values[labels]
    if relief is not None:
        height = height + relief[::step, ::step]
    return _picture(setting, ds.isel(material=sorted(shown)), about, height, ds["phase"].values[labels], "materials")


def lever_in_water(lever: Cantilever) -> str:
    """Sentence on a lever that the sliders describe in air, once it is in water."""
    modes = (
        f"{say(one.frequency_ratio * lever.resonance_frequency, 'Hz', 3)} (Q {one.quality_factor:.2g})"
        for one in lever.eigenmodes
    )
    return f"In water the lever resonates at {' and '.join(modes)}; the sliders say what it is in air."


def _solved(setting: Setting) -> tuple[Work, xr.Dataset]:
    """Variables that engaging from far finds on each material, as an image with a pixel of each has them."""
    scope = setting.scope
    materials, viscous = rows_of(setting.materials.values())
    work = make_work(materials, viscous, scope, setting.setpoint * scope.driven_amplitude, marched=True)
    rows, status, used = run(by_name(setting.solver), work, accuracy_of(scope), threads=1)
    rows = widened(rows, work, used, scope, lambda: work.rows, OF_SECOND if scope.drive.second else ())
    flags = {"status": status, "solver": used, "branch": branch_of(rows), "motion": motion_of(rows, work.lever)}
    names = VARIABLES + (OF_SECOND if scope.drive.second else ())
    values = {name: flags[name] if name in flags else FLOATS[name].value(rows) for name in names}
    if (film := film_of(materials)) is not None:
        values["thickness"] = film[:, 1]
    about = {"microscope": describe(scope), "solver": setting.solver}
    forces = dict(zip(FORCES, forces_of(materials, viscous, scope), strict=True))
    data = {name: ("material", one) for name, one in values.items()}
    return work, xr.Dataset(data, attrs={"configuration": json.dumps(about), **forces})


def image(setting: Setting) -> xr.Dataset:
    """The whole image, as the scene of the subject says it is taken; what the page saves."""
    from phasemap.imaging.simulation import simulate

    subject = setting.subject
    if subject.scene is not None and setting.fits_a_scene:
        surface = seen_by_tip(subject.scene.config["surface"], setting.surface, setting.scope, setting.setpoint)
        return scene_from_tables(setting.tables(), subject.folder, surface).simulate()
    return simulate(setting.surface, setting.scope, **setting.options)


def scan(setting: Setting) -> DrawnImage:
    """The whole image for the page to draw; of one that is taken in two directions the trace."""
    with untold():
        ds = image(setting)
    ds = ds.isel(direction=0) if "direction" in ds.dims else ds
    about = {
        "step": 1,
        "free_amplitude": setting.scope.driven_amplitude,
        "shape": list(ds["height"].shape),
        "pixel": [2 * float(ds[dim].min()) for dim in ("y", "x")],
    }
    return _picture(setting, ds, about, ds["height"].values, ds["phase"].values, "pixels")


def curves(setting: Setting) -> dict[str, Any]:
    """Amplitude and phase against the distance, and one period at the working point, of both materials of the pair.

    Returns: for each material, by name: the complete curve (distance and amplitude [nm], phase [degree], stable,
        piece), the jumps of approach and retract, the working point, and deflection [nm] and force [nN] over a
        period, which is None of what only the march in time knows. None for one that the law of contact cannot have.
    """
    by_material: dict[str, Any] = {}
    for name in dict.fromkeys(setting.pair):
        try:
            by_material[name] = _curve(setting, setting.materials[name])
        except InputError:  # a material that the law of contact cannot have; the picture says so
            by_material[name] = None
    return by_material


def contrast_map(setting: Setting) -> dict[str, Any]:
    """Contrast of the pair against setpoint and free amplitude [degree], points where it is 0, and where to work."""
    first, second = setting.pair
    amplitudes = AMPLITUDES * middle_of(setting)
    ds = contrast(
        setting.materials[first], setting.materials[second], setting.scope, SETPOINTS, amplitudes,
        solver=setting.solver, accuracy=accuracy_of(setting.scope), names=(first, second), threads=1,
    )  # fmt: skip
    return {
        "setpoints": SETPOINTS.tolist(),
        "amplitudes": (amplitudes * 1e9).tolist(),
        "contrast": _numbers(ds["contrast"].values * (-1 if setting.lag else 1), 2),
        "zeros": [ds["inversion_setpoint"].values.tolist(), (ds["inversion_free_amplitude"].values * 1e9).tolist()],
        "recommendation": ds.attrs["recommendation"] + " (Of the phase; the lag has the other sign.)" * setting.lag,
        "best": _numbers(np.array([ds.attrs["best_setpoint"], ds.attrs["best_free_amplitude"] * 1e9]), 6),
    }


def middle_of(setting: Setting) -> float:
    """The free amplitude [m] in the middle of the map: the subject's, or times a power of 4, so that maps can stay."""
    base = setting.subject.scope.drive.free_amplitude
    return float(base * 4.0 ** round(math.log(setting.scope.drive.free_amplitude / base, 4.0)))


def _picture(
    setting: Setting, ds: xr.Dataset, about: dict[str, Any], height: NDArray[np.float64], phase: NDArray[np.float64],
    what: str,
) -> DrawnImage:  # fmt: skip
    """Maps of an image as the page wants them, and sentences on the materials or pixels in `ds`."""
    height = height * 1e9
    height = height - (float(np.nanmin(height)) if np.isfinite(height).any() else 0.0)
    phase = setting.counted(phase)
    about |= matched(setting, about["step"], height, phase)
    about |= {
        "failed": describe_failures(ds, what),
        "warnings": [*setting.warnings, *filter(None, [far_off(setting.scope)]), *describe_validity(ds, what)],
    }
    return DrawnImage(about, height.astype(np.float32), phase.astype(np.float32))


def matched(
    setting: Setting, step: int, height: NDArray[np.float64], phase: NDArray[np.float64]
) -> dict[str, dict[str, Any]]:
    """Shifts that bring the measured image, whose zeros are arbitrary, to every `step`-th pixel of the simulated one.

    Where something was measured, under "measured" the shifts of height [nm] and phase [degree], the mean distance of
    the medians of the regions, weighted by their areas; and the contrast of both in a sentence.
    """
    subject = setting.subject
    if subject.measured is None:
        return {}
    labels = subject.sample.labels[::step, ::step]
    seen_height, seen_phase = subject.measured.drawn(step)
    seen_phase = setting.counted(seen_phase)
    phases, off = [], []
    for label in range(len(setting.materials)):
        here = (labels == label) & np.isfinite(phase)
        levels = [np.median(one[here]) if here.any() else math.nan for one in (phase, seen_phase)]
        phases.append(levels)
        if here.any():
            between = float(np.median(height[here] - seen_height[here]))
            off.append((here.sum(), between, levels[0] - levels[1]))
    shares, heights, degrees = np.array(off or [(1, 0.0, 0.0)]).T
    first, second = (list(setting.materials).index(name) for name in setting.pair)
    simulated, measured = np.subtract(phases[second], phases[first])
    pair = f"{setting.pair[1]} less {setting.pair[0]}"
    says = f"Contrast ({pair}): measured {measured:+.1f}°, simulated {simulated:+.1f}°." if first != second else ""
    shifts = {name: float(np.average(one, weights=shares)) for name, one in (("height", heights), ("phase", degrees))}
    return {"measured": {**shifts, "says": says if math.isfinite(simulated) else ""}}


def _found(setting: Setting, name: str, ds: xr.Dataset, material: int, bistable: bool) -> PointMotion:
    """Motion that engaging from far finds on one material, for the sentences."""
    values = {key: ds[key].values.tolist()[material] for key in VARIABLES}
    words = {key: word_of(key, values[key]) for key in ("branch", "motion", "solver")}
    lever, amplitude = lever_of(setting.scope), setting.setpoint * setting.scope.driven_amplitude
    tip_amplitude, tip_phase = of_tip(lever, amplitude, math.radians(values["phase"]))
    orbit = {name: ds[name].values[material] for name in OF_SECOND if name in ds}
    status = Status.of(values["status"])
    return PointMotion.of(
        lever, amplitude, values["phase"],
        name=name, regime=words["branch"], bistable=bistable, motion=words["motion"], solver=words["solver"],
        advice="" if status is Status.good else status.value, lost=values["dissipation"], virial=values["virial"],
        indentation=values["indentation"], tip_offset=values["tip_offset"],
        second=_second_shown(TipMotion(lever, setting.scope, tip_amplitude, tip_phase, orbit)),
    )  # fmt: skip


def _second_shown(motion: TipMotion) -> str:
    """Sentence on the signal of a driven second mode."""
    second = motion.scope.drive.second
    if second is None or not math.isfinite(float(motion.orbit["mean_gradient"])):
        return ""
    shown = {name: float(CHANNELS[name].value(motion)) for name in OF_SECOND_MODE[second.detection]}
    if "mode2_frequency_shift" in shown:
        shift = shown["mode2_frequency_shift"]
        return f"the second mode's resonance is {shown_number(abs(shift))} Hz {'higher' if shift > 0 else 'lower'}"
    return f"the second mode has {1e12 * shown['mode2_amplitude']:.3g} pm at a phase of {shown['mode2_phase']:.3g}°"


def _plain(found: PointMotion, setting: Setting) -> dict[str, Any]:
    """Material as JSON has it."""
    values = {**found._asdict(), "phase": setting.counted(found.phase)}
    return {key: None if value != value or value in INFINITE else value for key, value in values.items()}


def _curve(setting: Setting, material: Material) -> dict[str, Any]:
    """Amplitude and phase of one material against the distance, for the page."""
    scope = setting.scope
    pixel = solve_pixel(material, scope, setting.setpoint, setting.solver, accuracy_of(scope))
    free = scope.driven_amplitude
    low, high = DEEPEST * free, max(HIGHEST * free, free + BEYOND)
    axis = np.linspace(low, high, POINTS)
    works = math.isfinite(pixel.tip_offset)
    if works:
        low, high = min(low, pixel.tip_offset - 0.1 * free), max(high, pixel.tip_offset + 0.1 * free)
        axis = np.unique(np.append(np.linspace(low, high, POINTS), pixel.tip_offset))
    in_time = Question(material, scope).only_in_time
    ds = sweep_distance(material, scope, axis[::-1], samples=0 if in_time else SAMPLES)
    points = {name: ds[f"curve_{name}"].values for name in ("tip_offset", "amplitude", "phase", "stable", "piece")}
    if in_time:  # the way there and that back, for there are no orbits between them
        points = {name: ds[name].values.reshape(-1) for name in ("amplitude", "phase")}
        points |= {"tip_offset": np.tile(ds["tip_offset"].values, 2), "stable": np.ones(2 * len(axis), np.int8)}
        points["piece"] = np.repeat(np.arange(2), len(axis))
    answer: dict[str, Any] = {
        "distance": _numbers(points["tip_offset"] * 1e9, 3),
        "amplitude": _numbers(points["amplitude"] * 1e9, 3),
        "phase": _numbers(setting.counted(points["phase"]), 2),
        "stable": points["stable"].tolist(),
        "piece": points["piece"].tolist(),
        "jumps": [
            [
                _numbers(ds[f"jump_{end}_amplitude"].values * 1e9, 3),
                _numbers(setting.counted(ds[f"jump_{end}_phase"].values), 3),
            ]
            for end in ("from", "to")
        ],
        "jump_distance": _numbers(ds["jump_tip_offset"].values * 1e9, 3),
        "jump_direction": ds["jump_direction"].values.tolist(),
        "range": [low * 1e9, high * 1e9],
        "point": None,
        "period": None,
    }
    if works:
        answer["point"] = [pixel.tip_offset * 1e9, pixel.amplitude * 1e9, setting.counted(pixel.phase)]
        answer["period"] = None if in_time else _period(ds, pixel.tip_offset, pixel.phase)
    return answer


def _period(ds: xr.Dataset, tip_offset: float, phase: float) -> dict[str, Any] | None:
    """Deflection and force over one period of the orbit at this distance, in the direction whose curve is on it."""
    traces = ds[["phase", "trace_deflection", "trace_force"]]
    here = traces.isel(tip_offset=int(np.argmin(np.abs(ds["tip_offset"].values - tip_offset))))
    away = np.abs(here["phase"].values - phase)
    if not (away < SAME).any():
        return None
    orbit = here.isel(direction=int(np.nanargmin(away)))
    return {
        "surface": tip_offset * 1e9,
        "deflection": _numbers(orbit["trace_deflection"].values * 1e9, 4),
        "force": _numbers(orbit["trace_force"].values * 1e9, 4),
    }


def _numbers(values: NDArray[Any], digits: int) -> Any:
    """Numbers as JSON has them, None for those that are not finite."""

    def plain(value: Any) -> Any:
        return list(map(plain, value)) if isinstance(value, list) else value if math.isfinite(value) else None

    return plain(np.round(values, digits).tolist())
