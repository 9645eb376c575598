"""Any two options of `simulate` together: the numbers are those of the plain way, or one sentence refuses them first.

The plain way is an image in memory, at one setpoint, by one thread, without a checkpoint, of materials that are all
kept and never interpolated; and pixel by pixel that of `solve_pixel`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import dask
import dask.array as da
import numpy as np
import pytest
import xarray as xr
from pairs import Case, Options, Pairs

import phasemap as pm
from phasemap._kernels.columns import INTERPOLATED
from phasemap.experiment.material_rows import materials_of
from phasemap.imaging import checkpoint, engaged, raster, simulation
from phasemap.imaging import dask as blocks
from phasemap.imaging.checkpoint import Checkpoint
from phasemap.imaging.feedback import simulator as feedback
from phasemap.imaging.imperfections import drifted
from phasemap.imaging.interpolation import atlas

OPTIONS: Options = {  # the first of each is the plain one
    "control": ("engage", "raster line", "raster image", "feedback line", "feedback image"),
    "contact": ("dmt", "jkr", "film", "films", "liquid"),
    "loss": ("none", "damping", "viscosity", "relaxation", "spectrum", "ting"),
    "solver": ("auto", "orbit", "averaging", "march"),
    "maps": ("memory", "labels", "blocks", "labels in blocks"),
    "lever": ("one mode", "two modes", "in water", "fm", "am"),
    "drive": ("resonance", "base", "detuned"),
    "setpoints": ("one", "two"),
    "checkpoint": ("none", "killed"),
    "pixels": ("all", "holes"),
    "materials": ("few", "blocks of lines", "interpolated"),
    "realism": ("none", "changed tip", "drift", "offsets", "bits", "noise"),
    "variables": ("default", "loss tangent", "integrals"),
    "strict": ("no", "yes"),
    "progress": ("none", "told"),
}
RASTER, FEEDBACK = ("raster line", "raster image"), ("feedback line", "feedback image")
IN_TIME, WET, SECOND = ("relaxation", "spectrum", "ting"), ("liquid",), ("fm", "am")
LAZY, LABELS = ("blocks", "labels in blocks"), ("labels", "labels in blocks")
REFUSED: list[tuple[str, Options]] = [  # what the sentence is about, and options that it refuses
    ("checkpoint", {"maps": LAZY, "checkpoint": ("killed",)}),
    ("strict", {"maps": LAZY, "strict": ("yes",)}),
    ("progress", {"maps": LAZY, "progress": ("told",)}),
    ("surface", {"maps": LAZY, "loss": ("ting",)}),
    ("relaxation", {"maps": LAZY, "loss": ("spectrum",)}),
    ("drift", {"maps": LAZY, "realism": ("drift",)}),
    ("bits", {"maps": LAZY, "realism": ("bits",)}),
    ("contact", {"contact": ("jkr", "film", "films"), "loss": ("ting",)}),
    ("contact", {"contact": ("jkr",), "loss": ("relaxation", "spectrum")}),
    ("solver", {"control": FEEDBACK, "solver": ("orbit",)}),
    ("solver", {"loss": IN_TIME, "solver": ("orbit", "averaging")}),
    ("solver", {"contact": WET, "solver": ("orbit", "averaging")}),
    ("control", {"loss": IN_TIME, "control": RASTER}),
    ("control", {"contact": WET, "control": RASTER}),
    ("second", {"loss": IN_TIME, "lever": SECOND}),
    ("second", {"contact": WET, "lever": SECOND}),
    ("variables", {"loss": IN_TIME, "variables": ("integrals",)}),
    ("variables", {"contact": WET, "variables": ("integrals",)}),
    ("variables", {"control": FEEDBACK, "variables": ("integrals",)}),
    ("temperature", {"control": ("engage", *RASTER), "realism": ("noise",)}),
    ("solver", {"control": RASTER, "solver": ("march",), "lever": SECOND}),
]
IDLE: list[Options] = [  # options that do nothing together, cannot be asked for, or take too long
    {"materials": ("interpolated",), "solver": ("orbit", "averaging", "march")},
    {"materials": ("interpolated",), "control": FEEDBACK},
    {"materials": ("interpolated",), "control": RASTER, "lever": SECOND},
    {"materials": ("interpolated",), "control": RASTER, "variables": ("integrals",)},
    {"maps": LABELS, "pixels": ("holes",)},
    {"solver": ("march",), "lever": SECOND, "setpoints": ("two",)},
    *(
        {name: values, "materials": ("interpolated",), option: slow}
        for name, values in (("loss", IN_TIME), ("contact", WET))
        for option, slow in (("lever", ("two modes", "in water")), ("setpoints", ("two",)), ("drive", ("base",)))
    ),
]
THREES: list[Case] = [  # that met in a fault: plans of images in blocks or of many materials
    {"materials": materials, **more}
    for materials in ("blocks of lines", "interpolated")
    for more in (
        *({"contact": contact, "maps": "blocks"} for contact in OPTIONS["contact"]),
        *({"control": control, "solver": "auto"} for control in OPTIONS["control"] if control not in FEEDBACK),
    )
]


PAIRS = Pairs(OPTIONS, REFUSED, IDLE)
SHAPE = (2, 3)
RNG = np.random.default_rng(1)
WHICH = np.array([[0, 1, 2], [2, 1, 0]])
MODULUS, DAMPING = RNG.uniform(1e9, 3e9, 3), RNG.uniform(0.005, 0.02, 3)
ADHESION = np.array([0.02, 0.08, 0.1])  # the first repels the tip; on the others a tip from far is attracted
THICKNESS, RATIO, LIQUID = RNG.uniform(1e-8, 4e-8, 3), RNG.uniform(0.2, 0.4, 3), RNG.uniform(2e-10, 4e-10, 3)
RUBBER = pm.Prony([0.5e9, 0.5e9], [20e-9, 200e-9], 0.5e9)
RELIEF = np.linspace(0.0, 3e-10, 6).reshape(SHAPE)
SETPOINTS = {"one": [0.7], "two": [0.7, 0.6]}
BLUNTER, DRIFT = pm.TipChange(1, 12e-9), (3e-9, 2e-9, 1e-10)
IMPERFECT = {
    "none": None,
    "changed tip": pm.Realism(tip_change=BLUNTER),
    "drift": pm.Realism(drift=DRIFT),
    "offsets": pm.Realism(line_offset=1e-10, phase_offset=0.1),
    "bits": pm.Realism(bits=8),
    "noise": pm.Realism(temperature=300.0, detector_noise=1e-13),
}
ALL_CONTROLS = ["phase", "height", "branch", "solver", "loss_tangent", "dissipation"]
ERRORS = ["error_phase", "error_height"]
INTEGRALS = ["loss_tangent_corrected", "amplitude_2", "mean_gradient"]


def surface_in_memory(case: Case) -> pm.Surface:
    """The surface, of arrays."""
    which = np.zeros_like(WHICH) if case["materials"] == "interpolated" else WHICH  # along one axis, which is quicker
    maps: dict[str, Any] = {"modulus": MODULUS[which], "adhesion": ADHESION[WHICH]}
    if case["contact"] == "jkr":  # necks of much adhesion take long
        maps["adhesion"] = 0.2 * maps["adhesion"]
    if case["contact"] in ("film", "films"):
        maps |= {"thickness": 2e-8} if case["contact"] == "film" else {
            "thickness": THICKNESS[WHICH], "poisson_ratio": RATIO[WHICH]
        }  # fmt: skip
    if case["contact"] == "liquid":
        maps["liquid_film"] = LIQUID[WHICH]
    if case["loss"] == "damping":
        maps["damping"] = DAMPING[WHICH]
    if case["loss"] in ("viscosity", "ting"):
        maps["viscosity"] = 10.0
    if case["loss"] == "relaxation":
        maps |= {"relaxed_modulus": 0.5 * maps["modulus"], "relaxation_time": 5e-8}
    if case["loss"] == "spectrum":
        maps |= {"relaxation": RUBBER, "modulus": np.full(SHAPE, RUBBER.instantaneous)}
    holes = case["pixels"] == "holes"
    if holes:
        maps["modulus"][0, 1] = np.nan
    return pm.Surface(**maps, topography=RELIEF, pixel_size=4e-9, allow_nan=holes)


def surface_of(case: Case) -> pm.Surface:
    """The surface, of arrays or labels, in memory or in blocks."""
    plain = surface_in_memory(case)
    in_blocks = case["maps"] in LAZY
    if case["maps"] in LABELS:
        materials, labels = plain.unique()
        known = materials_of(materials, plain.viscosity is not None)
        given = da.from_array(labels, chunks=((1, 1), (2, 1))) if in_blocks else labels
        return pm.Surface.from_labels(given, known, topography=RELIEF, pixel_size=4e-9)
    if not in_blocks:
        return plain
    maps = {name: one.data for name, one in plain.to_dataset().items()}
    given = {
        name: da.from_array(one, chunks=((1, 1), (2, 1))) if any(one.strides) else one[0, 0]
        for name, one in maps.items()
    }
    return pm.Surface(**given, pixel_size=4e-9, allow_nan=plain.allow_nan)


def scope_of(case: Case) -> pm.Microscope:
    kind, contact = case["lever"], case["contact"]
    lever = pm.Cantilever(4.0, 300e3, 21.0, modes=() if kind == "one mode" else 2)
    if kind == "in water":
        lever = pm.Cantilever(20.0, 300e3, 6.0, modes=(pm.Eigenmode(7.5, 6.0),))
    drive = pm.Drive(
        10e-9,
        301e3 if case["drive"] == "detuned" else None,
        "base" if case["drive"] == "base" else "direct",
        pm.Mode(0.05e-9, kind) if kind in SECOND else None,
    )
    law = {"films": "film", "liquid": "capillary"}.get(contact, contact)
    interaction = pm.Interaction(law, withdrawal="ting" if case["loss"] == "ting" else "linear")
    return pm.Microscope(lever, pm.Tip(10e-9), drive, interaction, "tip" if kind == "two modes" else "slope")


def control_of(case: Case) -> Any:
    kind, *when = case["control"].split()
    if kind == "feedback":
        gains = (0.2, 5e3) if when[0] == "image" else (None, None)  # those of the others are tuned
        return pm.Feedback(3000.0, *gains, bandwidth=40e3, engage=when[0])
    return pm.Raster(*when) if kind == "raster" else pm.Engage()


def options_of(case: Case) -> dict[str, Any]:
    """Options that change the numbers."""
    names = ALL_CONTROLS + (INTEGRALS if case["variables"] == "integrals" else [])
    return {
        "solver": case["solver"],
        "control": control_of(case),
        "realism": IMPERFECT[case["realism"]],
        "variables": None
        if case["variables"] == "default"
        else names + ([] if case["control"] in FEEDBACK else ERRORS),
    }


def told_of(case: Case, said: list[tuple[int, int]]) -> dict[str, Any]:
    """Options by which a user is told of pixels."""
    progress = (lambda done, total: said.append((done, total))) if case["progress"] == "told" else None
    return {"progress": progress, "strict": case["strict"] == "yes"}


@pytest.fixture(autouse=True)
def _one_thread_for_blocks() -> Iterator[None]:
    with dask.config.set(scheduler="synchronous"):
        yield


AT_REST = [(engaged, "FEW"), (engaged, "MOST"), (raster, "FEW"), (raster, "MOST"), (feedback, "MOST")]
IN_TIME_TOO = [(engaged, "MANY"), (engaged, "MANY_DRY"), (engaged, "KINDS")]
"""Limits of the number of materials, with their modules: above some they are not all kept, or interpolated."""


def in_time(case: Case) -> bool:
    return case["loss"] in IN_TIME or case["contact"] in WET


class Killed(Exception):
    """In place of the end of a process."""


def asked(case: Case, patch: pytest.MonkeyPatch, folder: Path) -> tuple[xr.Dataset, list[tuple[int, int]]]:
    """The image with all options together, and what its progress said."""
    said: list[tuple[int, int]] = []
    options = options_of(case) | told_of(case, said)
    limits = {"few": [], "blocks of lines": AT_REST, "interpolated": IN_TIME_TOO if in_time(case) else AT_REST}
    for module, name in limits[case["materials"]]:
        patch.setattr(module, name, 2)
    if case["materials"] == "interpolated":
        patch.setattr(atlas, "LEAST", 1)
        patch.setattr(atlas, "WORTH", 1e3)
    at = SETPOINTS[case["setpoints"]]
    given = surface_of(case), scope_of(case), at[0] if len(at) == 1 else at
    if case["checkpoint"] == "killed":
        options["checkpoint"] = folder
        patch.setattr(checkpoint, "EVERY", 0.0)
        patch.setattr(checkpoint, "GROWTH", 1)  # each line is kept by itself, and the second is not reached
        keep = Checkpoint.keep

        def keep_and_die(self: Checkpoint, lines: checkpoint.FilledLines) -> None:
            keep(self, lines)
            raise Killed

        with pytest.MonkeyPatch.context() as killing:
            killing.setattr(Checkpoint, "keep", keep_and_die)
            with pytest.raises(Killed):
                pm.simulate(*given, **options, threads=1)
    return pm.simulate(*given, **options, threads=1 if case["checkpoint"] == "killed" else 3).compute(), said


def in_the_plain_way(case: Case) -> xr.Dataset:
    """The image as it is without the options that should change no number, with a dim of setpoints.

    Each setpoint has random numbers of its own, those of the next seed.
    """
    given, options = (surface_in_memory(case), scope_of(case)), options_of(case)
    images, realism = [], options.pop("realism", None) or pm.Realism()
    for i, setpoint in enumerate(SETPOINTS[case["setpoints"]]):
        noise = replace(realism, seed=realism.seed + i)
        images.append(pm.simulate(*given, setpoint, **options, realism=noise, threads=1))
    return xr.concat(images, "setpoint", combine_attrs="drop")


def assert_same(image: xr.Dataset, plain: xr.Dataset) -> None:
    """Bit for bit."""
    for name, one in plain.data_vars.items():
        mine = image[name]
        assert mine.dims == one.dims and mine.dtype == one.dtype, name
        np.testing.assert_array_equal(mine.values, one.values, err_msg=str(name))


def assert_within_errors(image: xr.Dataset, plain: xr.Dataset, steps: float) -> None:
    """Within the errors that both state; of what is digitised in so many steps, one more."""
    for name in ("status", "branch"):
        if name in plain:
            np.testing.assert_array_equal(image[name], plain[name], err_msg=name)
    for name, least in (("phase", 1e-6), ("height", 1e-16)):
        error = image[f"error_{name}"].fillna(0) + plain[f"error_{name}"].fillna(0) + least
        error += (plain[name].max() - plain[name].min()) / steps
        assert (abs(image[name] - plain[name]) <= error).where(plain[name].notnull(), True).all(), name
        np.testing.assert_array_equal(np.isnan(image[name]), np.isnan(plain[name]), err_msg=name)


def pixel_by_pixel(case: Case, setpoint: float) -> Iterator[tuple[tuple[int, int], pm.Pixel | None, float]]:
    """Pixels that have a material, with what `solve_pixel` finds there and the height of the ground."""
    surface, scope = surface_in_memory(case), scope_of(case)
    if case["realism"] == "drift":
        surface = drifted(surface, DRIFT)
    materials, numbers = surface.unique()
    whole = np.isfinite(materials[:, 0])
    known = dict(zip(np.flatnonzero(whole), materials_of(materials[whole], surface.viscosity is not None), strict=True))
    tips = [pm.Tip(BLUNTER.radius if case["realism"] == "changed tip" and row else 10e-9) for row in range(SHAPE[0])]
    found: dict[Any, pm.Pixel | None] = {}
    for place in np.ndindex(SHAPE):
        if (number := numbers[place]) in known:
            tip = tips[place[0]]
            if (number, tip) not in found:
                found[number, tip] = solved(known[number], replace(scope, tip=tip), setpoint, case["solver"])
            yield place, found[number, tip], float(surface.topography[place])


def solved(material: pm.Material, scope: pm.Microscope, setpoint: float, solver: str) -> pm.Pixel | None:
    """What `solve_pixel` finds, or None where it refuses a neck that would create energy."""
    try:
        return pm.solve_pixel(material, scope, setpoint, solver)
    except pm.InputError as refused:
        if refused.name != "contact":
            raise
        return None


def assert_as_by_pixel(case: Case, image: xr.Dataset) -> None:
    """Engaged pixels, and those of a `Raster` on the branch that engagement finds, are those of `solve_pixel`."""
    last = image.isel(setpoint=-1)
    for (y, x), pixel, ground in pixel_by_pixel(case, SETPOINTS[case["setpoints"]][-1]):
        here = last.isel(y=y, x=x)
        if pixel is None:
            assert (here.status == pm.Status.creates_energy.code).all()
            continue
        for one in [here.isel(direction=i) for i in range(here.sizes.get("direction", 0))] or [here]:
            if "direction" in one.coords and pixel.branch != BRANCHES[int(one.branch)]:
                continue
            assert int(one.status) == pixel.status.code
            for name, value, least in (("phase", pixel.phase, 1e-6), ("height", pixel.height + ground, 1e-16)):
                errors = float(one[f"error_{name}"]), getattr(pixel, f"error_{name}")
                assert abs(float(one[name]) - value) <= np.nansum(errors) + least or pixel.status.code, (name, y, x)


def expected_to_be_interpolated(case: Case) -> bool:
    """Necks are not, nor what differs in more than an atlas has axes for."""
    return case["contact"] in ("dmt", "film") and case["loss"] != "ting"


BRANCHES = {-1: "none", 0: "attractive", 1: "repulsive"}


@pytest.mark.parametrize("case", PAIRS.cases(THREES), ids=PAIRS.label)
def test_numbers_are_those_of_the_plain_way(case: Case, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plain = in_the_plain_way(case)
    if case["strict"] == "yes" and plain.status.any():
        with pytest.raises(pm.SolveError, match="no solution"):
            asked(case, monkeypatch, tmp_path)
        return
    image, said = asked(case, monkeypatch, tmp_path)
    assert ("setpoint" in image.dims) == (case["setpoints"] == "two")
    if "setpoint" not in image.dims:
        image = image.expand_dims("setpoint")
    if case["materials"] == "interpolated":
        assert (image.solver == INTERPOLATED).any() or not expected_to_be_interpolated(case)
        assert_within_errors(image, plain, 255 if case["realism"] == "bits" else np.inf)
    else:
        assert_same(image, plain)
    if case["control"] not in FEEDBACK and case["realism"] in ("none", "changed tip", "drift"):
        assert_as_by_pixel(case, image)
    assert bool(said) == (case["progress"] == "told")
    assert all(0 <= done <= total for done, total in said) and all(done == total for done, total in said[-1:])


@pytest.mark.parametrize("case", PAIRS.never(), ids=PAIRS.label)
def test_what_does_not_go_together_is_refused_in_a_sentence_before_work_starts(
    case: Case, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    options = options_of(case) | told_of(case, [])
    if case["checkpoint"] == "killed":
        options["checkpoint"] = tmp_path
    work, at = [(simulation, "plan_image"), (blocks, "plan_image")], SETPOINTS[case["setpoints"]]
    PAIRS.assert_refused(case, lambda: pm.simulate(surface_of(case), scope_of(case), at, **options), monkeypatch, work)
