"""How well does a method read phase images?

Twelve samples, from easy to bistable, each scanned in time at two setpoints with the noise of lever and detector, and
the truth behind them: a benchmark by which methods that segment or invert phase images can be compared. Everything is
fixed by seeds, and what changes any image changes VERSION; another one's scores are not to be compared. There are three
sizes of the same scenes; the small one is below.

A method is a function that is given a `Task`: the images, trace and retrace with their settings, the microscope, the
number of materials, and that the phase is 0 at free resonance. It returns an `Answer`: a label for each pixel, in any
numbering, and if it can Young's modulus [Pa], NaN where it does not know. Two scores are from 0 to 1:

* segmentation: pixels that are rightly a material's over those that are its own or were said to be, mean of all
  materials, with the labels numbered as suits them best
* inversion: the share of pixels whose modulus is within a factor of 1.5

The truth scores 1 and 1 in every case. What knows nothing scores, as the mean of the small set, 0.27 with one label
for all pixels, 0.33 with labels at random, and 0.18 with 1 GPa everywhere, which two cases have in all materials.

`run({"mine": method}, "large")` scores one; `write(folder, "large")` puts images and truth into netCDF files. Two
methods are scored here: a threshold of the phase at the lower setpoint, and the package's fit of materials to these
regions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from scipy.optimize import linear_sum_assignment

import phasemap as pm
from phasemap.io.measured import segment_phase

NAME, VERSION = "phasemap-benchmark", 4
SIZES = {"small": 32, "medium": 64, "large": 128}  # pixels of 4 nm along each side
PIXEL = 4e-9
FACTOR = 1.5  # by which a modulus may be wrong
CHANNELS = ["height", "phase", "amplitude_error"]
LEVER, TIP = pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=300.0), pm.Tip(radius=10e-9)

Labels = Callable[[tuple[int, int]], np.ndarray]
PS = pm.Material(2.5e9, adhesion=0.07, damping=0.008)
LDPE = pm.Material(0.3e9, adhesion=0.06, damping=0.03)


def blend(seed: int, fraction: float = 0.45) -> Labels:
    """Spinodal decomposition."""
    return lambda shape: pm.generate.blend(shape, PIXEL, spacing=55e-9, fraction=fraction, seed=seed)


def stripes(shape: tuple[int, int]) -> np.ndarray:
    """Straight stripes, slanted."""
    return pm.generate.stripes(shape, PIXEL, period=50e-9, angle=20.0)


def lamellae(shape: tuple[int, int]) -> np.ndarray:
    """A block copolymer, whose lamellae are two pixels wide."""
    return pm.generate.lamellae(shape, PIXEL, period=18e-9, seed=4)


def particles(shape: tuple[int, int]) -> np.ndarray:
    """Discs in a matrix."""
    return pm.generate.particles(shape, PIXEL, radius=16e-9, area_fraction=0.3, seed=5)


def filled_blend(shape: tuple[int, int]) -> np.ndarray:
    """Particles in a blend."""
    filler = pm.generate.particles(shape, PIXEL, radius=13e-9, area_fraction=0.2, seed=8)
    return np.where(filler == 1, 2, blend(6)(shape))


@dataclass(frozen=True)
class Case:
    """A sample, and how it is scanned; `step` is how high each label stands above label 0, `relief` is rms [m]."""

    what: str
    labels: Labels
    materials: tuple[pm.Material, ...] = (PS, LDPE)
    step: float = 0.0
    relief: float = 0.3e-9
    setpoints: tuple[float, float] = (0.8, 0.55)
    free_amplitude: float = 40e-9
    dwell: float = 0.3e-3  # s a pixel
    detector_noise: float = 300e-15  # m/sqrt(Hz)
    worn: float | None = None  # m, the tip's radius in the lower half


CASES: Mapping[str, Case] = {
    "stripes": Case("two polymers, flat", stripes, relief=0.0),
    "blend": Case("two polymers, a little rough", blend(7)),
    "particles": Case(
        "stiff particles that stand out of a rubber", particles,
        (pm.Material(0.4e9, adhesion=0.08, damping=0.03), pm.Material(4e9, adhesion=0.05, damping=0.005)), step=2e-9,
    ),
    "lamellae": Case("lamellae as narrow as the tip is blunt", lamellae),
    "three": Case(
        "a blend with a filler: three materials", filled_blend,
        (PS, pm.Material(0.15e9, adhesion=0.05, damping=0.05), pm.Material(1e9, adhesion=0.06, damping=0.03)),
    ),
    "adhesion": Case(
        "equal stiffness and damping, other adhesion", blend(9),
        (pm.Material(1e9, adhesion=0.04, damping=0.02), pm.Material(1e9, adhesion=0.12, damping=0.02)),
    ),
    "relief": Case("relief that shows in the phase", blend(10), relief=6e-9, dwell=0.15e-3),
    "worn": Case("a tip that breaks halfway", blend(11), worn=25e-9),
    "hurried": Case("scanned four times as fast", blend(12), relief=1e-9, dwell=75e-6),
    "faint": Case(
        "a contrast of the size of the noise", blend(13),
        (pm.Material(1e9, adhesion=0.06, damping=0.02), pm.Material(0.95e9, adhesion=0.06, damping=0.021)),
        detector_noise=2e-12,
    ),
    "turning": Case(
        "a contrast that turns between the setpoints", blend(14),
        (pm.Material(0.1e9, adhesion=0.09, damping=0.005), pm.Material(0.4e9, adhesion=0.03, damping=0.1)),
        setpoints=(0.8, 0.6), free_amplitude=20e-9,
    ),
    "bistable": Case(
        "domains over which the tip takes either of two orbits", blend(15),
        (pm.Material(0.5e9, adhesion=0.1, damping=0.1), pm.Material(3e9, adhesion=0.15, damping=0.005)),
        relief=1e-9, setpoints=(0.93, 0.91), free_amplitude=20e-9,
    ),
}  # fmt: skip
"""From easy to bistable."""


@dataclass(frozen=True)
class Task:
    """What a method is given: images over ("direction", "y", "x") with their attribute ``setpoint``, and the rest."""

    images: tuple[xr.Dataset, ...]
    scope: pm.Microscope
    materials: int


@dataclass(frozen=True)
class Answer:
    """What a method returns, and what the truth is: over ("y", "x")."""

    labels: np.ndarray
    modulus: np.ndarray | None = field(default=None)


def make(name: str, size: str = "small") -> tuple[Task, Answer]:
    """One of `CASES` as a method is given it, and the truth."""
    case, pixels = CASES[name], SIZES[size]
    shape, seed = (pixels, pixels), list(CASES).index(name)
    labels = case.labels(shape)
    relief = case.step * labels
    if case.relief:
        relief = relief + pm.generate.roughness(shape, PIXEL, rms=case.relief, correlation_length=30e-9, seed=seed)
    surface = pm.Surface.from_labels(labels, case.materials, pixel_size=PIXEL, topography=relief)
    scope = pm.Microscope(LEVER, TIP, pm.Drive(case.free_amplitude))
    control = pm.Feedback()
    control = pm.Feedback(line_rate=control.line_rate * control.dwell(pixels) / case.dwell)
    worn = pm.TipChange(pixels // 2, case.worn) if case.worn else None
    images = []
    for number, setpoint in enumerate(case.setpoints):
        noise = pm.Realism(
            temperature=300.0,
            detector_noise=case.detector_noise,
            tip_change=worn,
            seed=100 * VERSION + 2 * seed + number,
        )
        image = pm.simulate(surface, scope, setpoint, control=control, realism=noise, variables=CHANNELS)
        about = {"setpoint": setpoint, "line_rate": control.line_rate}
        images.append(image[CHANNELS].drop_attrs(deep=False).assign_attrs(about))
    return Task(tuple(images), scope, len(case.materials)), Answer(labels, np.array(surface.modulus))


def score(answer: Answer, truth: Answer) -> dict[str, float]:
    """The scores of an answer, as described above; that of what was not answered is NaN."""
    found, count = np.unique(answer.labels, return_inverse=True)[1], len(np.unique(truth.labels))
    said = np.arange(max(found.max() + 1, count))[:, None, None] == found.reshape(truth.labels.shape)
    true = np.unique(truth.labels)[:, None, None] == truth.labels
    both = np.einsum("iyx,jyx->ij", said.astype(int), true.astype(int))
    overlap = both / (said.sum((1, 2))[:, None] + true.sum((1, 2)) - both)
    best = overlap[linear_sum_assignment(overlap, maximize=True)]
    scores = {"segmentation": float(best.sum() / count), "inversion": np.nan}
    if answer.modulus is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            scores["inversion"] = float(np.mean(abs(np.log2(answer.modulus / truth.modulus)) <= np.log2(FACTOR)))
    return scores


def threshold(task: Task) -> Answer:
    """Labels by thresholds of the phase at the lower setpoint."""
    image = min(task.images, key=lambda one: one.attrs["setpoint"])
    return Answer(segment_phase(image.phase.mean("direction").to_numpy(), task.materials))


def fitted(task: Task) -> Answer:
    """One material for each region of `threshold`, fitted to the contrasts of phase and height at both setpoints."""
    labels = threshold(task).labels
    images = [one.mean("direction", keep_attrs=True) for one in task.images]
    found = pm.fit_regions(images, labels, task.scope, phase_zero=0.0, phase_error=0.5, height_error=0.2e-9)
    return Answer(labels, found.modulus.sel(region=xr.DataArray(labels, dims=("y", "x"))).to_numpy())


METHODS = {"threshold": threshold, "fitted regions": fitted}


def run(methods: Mapping[str, Callable[[Task], Answer]], size: str = "small") -> dict[str, dict[str, Any]]:
    """Score methods on every case, and print a table; returns task, truth, answers and scores by the case's name."""
    print(f"{NAME} {VERSION}, {size}, phasemap {pm.__version__}: segmentation, inversion")
    print(f"{'':<11}" + "".join(f"{name:>20}" for name in methods))
    results: dict[str, dict[str, Any]] = {}
    for name in CASES:
        task, truth = make(name, size)
        answers = {method: answer(task) for method, answer in methods.items()}
        scores = {method: score(answer, truth) for method, answer in answers.items()}
        results[name] = {"task": task, "truth": truth, "answers": answers, "scores": scores}
        print(f"{name:<11}" + "".join(_cell(one) for one in scores.values()), flush=True)
    every = [[one["scores"][method] for one in results.values()] for method in methods]
    means = [{kind: np.mean([one[kind] for one in many]) for kind in many[0]} for many in every]
    print(f"{'mean':<11}" + "".join(_cell(one) for one in means))
    return results


def _cell(scores: Mapping[str, float]) -> str:
    told = scores["inversion"]
    return f"{scores['segmentation']:>13.2f}" + (f"{'-':>7}" if np.isnan(told) else f"{told:>7.2f}")


def write(folder: Path, size: str) -> None:
    """Write every case as NAME.nc, the images over "setpoint", and NAME_truth.nc."""
    for name, case in CASES.items():
        task, truth = make(name, size)
        at = xr.Variable("setpoint", list(case.setpoints))
        whole = xr.concat([one.drop_attrs(deep=False) for one in task.images], at)
        drive = {"free_amplitude": case.free_amplitude, "materials": task.materials, "what": case.what}
        lever = {key: getattr(LEVER, key) for key in ("stiffness", "resonance_frequency", "quality_factor")}
        about = {"benchmark": f"{NAME} {VERSION}", "phasemap_version": pm.__version__, "tip_radius": TIP.radius}
        whole.assign_attrs(**about, **lever, **drive).to_netcdf(folder / f"{name}.nc")
        maps = {"label": (("y", "x"), truth.labels), "modulus": (("y", "x"), truth.modulus, {"units": "Pa"})}
        xr.Dataset(maps, {dim: whole[dim] for dim in ("y", "x")}, about).to_netcdf(folder / f"{name}_truth.nc")


def main(folder: Path = Path(), size: str = "small") -> None:
    """Write benchmark.png."""
    results = run(METHODS, size)
    figure, panels = plt.subplots(8, 6, figsize=(9.4, 13.2), layout="constrained")
    rows = ("higher setpoint", "lower setpoint", "truth", "threshold")
    for number, (name, one) in enumerate(results.items()):
        column = panels[4 * (number // 6) :, number % 6]
        shown = sorted(one["task"].images, key=lambda image: -image.attrs["setpoint"])
        for axes, image in zip(column, shown, strict=False):
            axes.imshow(image.phase[0], cmap="cividis")
        column[2].imshow(one["truth"].labels, cmap="gray_r", vmin=0, vmax=2)
        column[3].imshow(one["answers"]["threshold"].labels, cmap="gray_r", vmin=0, vmax=2)
        column[0].set_title(name, fontsize=10)
        column[3].set_title(f"{one['scores']['threshold']['segmentation']:.2f}", fontsize=9, pad=2)
    for row, axes in enumerate(panels[:, 0]):
        axes.set_ylabel(rows[row % 4], fontsize=9)
    for axes in panels.flat:
        axes.set(xticks=[], yticks=[])
    figure.savefig(folder / "benchmark.png", dpi=120)


if __name__ == "__main__":
    main()
