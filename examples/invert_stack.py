"""Which materials are in a stack of phase images with unknown zeros?

Four images of a blend, at two setpoints and two free amplitudes, with realistic noise: 0.4 degrees in the phase, 0.05
nm in the height. Their zeros are unknown: the lock-in adds 37 degrees, and the height of every image has another zero.
A fit of the contrast between the two phases of the blend gives the zeros; with these, every pixel is solved by itself.
Pixels whose property the data do not determine are grey: a stiff matrix is hardly indented, and its adhesion does not
show.
"""

import textwrap
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm

import phasemap as pm
from phasemap.io.measured import segment_phase

SAMPLE = Path(__file__).parent.parent / "samples" / "blend.toml"
CHANGES = (
    "surface.shape=[64,64]", "surface.spacing=100e-9",
    "materials.ps.modulus=0.8e9", "materials.ps.damping=0.01",  # a softer matrix than polystyrene
    "materials.ldpe.poisson_ratio=0.35",  # as that of the prior: images know the plane modulus only
)  # fmt: skip
SETTINGS = ((40e-9, 0.5), (40e-9, 0.8), (80e-9, 0.5), (80e-9, 0.8))  # free amplitude [m], setpoint
NOISE = {"phase": 0.4, "height": 0.05e-9}  # degree, m
SHOWN = {"modulus": ("modulus (GPa)", 1e-9), "adhesion": ("adhesion (J/m²)", 1.0), "damping": ("damping α₁", 1.0)}


def measure(surface: pm.Surface, scopes: list[pm.Microscope]) -> list[xr.Dataset]:
    """Images as an instrument would have recorded them."""
    rng = np.random.default_rng(7)
    images = []
    for scope, (_, setpoint) in zip(scopes, SETTINGS, strict=True):
        image = pm.simulate(surface, scope, setpoint, variables=["phase", "height"])
        zeros = {"phase": 37.0, "height": rng.normal(0, 5e-9)}
        seen = {name: image[name] + zeros[name] + rng.normal(0, NOISE[name], surface.shape) for name in NOISE}
        images.append(xr.Dataset(seen, attrs={"setpoint": setpoint}))
    return images


def draw_images(axes: np.ndarray, images: list[xr.Dataset]) -> None:
    """What was recorded."""
    low, high = np.percentile([one.phase for one in images], (0.5, 99.5))
    for one, panel, (amplitude, setpoint) in zip(images, axes, SETTINGS, strict=True):
        shown = panel.imshow(one.phase, cmap="gray", vmin=low, vmax=high)
        panel.set_title(f"{amplitude * 1e9:.0f} nm, setpoint {setpoint}", fontsize=9, loc="left")
    plt.colorbar(shown, ax=list(axes), fraction=0.01, pad=0.01).set_label("recorded phase (degrees)", fontsize=8)


def draw_map(value: plt.Axes, error: plt.Axes, found: xr.Dataset, bit: int, name: str) -> None:
    """A property above its standard error; grey where it is not determined."""
    label, factor = SHOWN[name]
    known = (found.flag & 1 << bit) == 0
    shown = (factor * found[name]).where(known)
    low, high = np.nanpercentile(shown, (1, 99))
    value.set_facecolor("0.8")
    bar = plt.colorbar(value.imshow(shown, norm=LogNorm(low / 1.1, high * 1.1), cmap="viridis"), ax=value)
    bar.ax.yaxis.set_major_locator(plt.LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.yaxis.set_major_formatter(lambda x, _: f"{x:g}")
    bar.ax.yaxis.set_minor_formatter(plt.NullFormatter())
    value.set_title(label, fontsize=10, loc="left")
    percent = 100 * found[f"{name}_error"]
    plt.colorbar(error.imshow(percent, cmap="magma_r", vmin=0, vmax=50), ax=error, extend="max")
    error.set_title("standard error (%)", fontsize=9, loc="left")


def draw_regions(axes: plt.Axes, regions: xr.Dataset, surface: pm.Surface, labels: np.ndarray) -> None:
    """Each region's material over the true one, with intervals of 95 %."""
    for k, (color, shade) in enumerate((("C0", "dark"), ("C1", "bright"))):
        for i, name in enumerate(SHOWN):
            true = float(np.median(getattr(surface, name)[labels == k]))
            found, reach = float(regions[name][k]) / true, 1.96 * float(regions[f"{name}_error"][k])
            ends = [[-found * np.expm1(-reach)], [found * np.expm1(reach)]]
            label = f"{shade} region" if i == 0 else None
            axes.errorbar(i + 0.2 * (k - 0.5), found, ends, fmt="o", color=color, capsize=3, markersize=4, label=label)
    axes.axhline(1, color="0.3", linewidth=0.8)
    axes.set_yscale("log")
    axes.set_yticks([0.5, 1, 2], ["0.5", "1", "2"])
    axes.set_yticks([], minor=True)
    axes.set(xticks=range(3), xticklabels=SHOWN, xlim=(-0.5, 2.5), ylim=(0.3, 3.3))
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    axes.set_title("by regions: found over true", fontsize=9, loc="left")


def main(folder: Path = Path()) -> None:
    """Write invert_stack.png."""
    scene = pm.load_scene(SAMPLE, CHANGES)
    surface = scene.surface
    scopes = [replace(scene.microscope, drive=pm.Drive(amplitude)) for amplitude, _ in SETTINGS]
    images = measure(surface, scopes)

    labels = segment_phase(images[0].phase, 2)
    regions = pm.fit_regions(images, labels, scopes, phase_zero="shared")
    zero = f"Zero of the phase: {float(regions.phase_zero[0]):.2f} ± {float(regions.phase_zero_error[0]):.2f} degrees."
    zeros = {name: regions[name] for name in ("phase_zero", "phase_zero_error", "height_zero", "height_zero_error")}
    found = pm.invert(images, scopes, phase_error=NOISE["phase"], height_error=NOISE["height"], **zeros)

    verdict = ["By regions, the phase the lowest in 0:", *regions.attrs["verdict"].splitlines()[:-1], zero]
    verdict += ["By pixels:", found.attrs["verdict"]]
    print(*verdict, sep="\n")
    for i, name in enumerate(SHOWN):
        apart = np.log(found[name] / getattr(surface, name)) / found[f"{name}_error"]
        inside = abs(apart.values[(found.flag.values & 1 << i) == 0]) < 1.96
        print(f"{name}: true value within the stated 95 % in {100 * inside.mean():.0f} % of its determined pixels")

    figure, panels = plt.subplots(3, 4, figsize=(12, 8), layout="constrained")
    draw_images(panels[0], images)
    for i, name in enumerate(SHOWN):
        draw_map(panels[1, i], panels[2, i], found, i, name)
    for panel in (*panels[0], *panels[1:, :3].flat):
        panel.set(xticks=[], yticks=[])
    panels[0, 0].set_xlabel(f"{surface.shape[1] * surface.pixel_size[1] * 1e9:.0f} nm wide", fontsize=9)
    draw_regions(panels[1, 3], regions, surface, labels)
    panels[2, 3].axis("off")
    lines = "\n\n".join(textwrap.fill(line, 38) for line in verdict)
    panels[2, 3].text(0, 1, lines, fontsize=8, va="top", transform=panels[2, 3].transAxes)
    figure.savefig(folder / "invert_stack.png", dpi=150)


if __name__ == "__main__":
    main()
