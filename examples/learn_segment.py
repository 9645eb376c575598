"""Can a small model tell the materials where a threshold cannot?

Blends of a glass and a rubber, each of other polymers, tapped at another setpoint and scanned in time with noise. The
rubber is the dark phase in some images and the bright one in others, edges and relief leave their marks in the phase,
and the feedback smears them. A random forest learns from eighteen images, pixel by pixel, and is tested on six that it
has not seen, of other patterns and materials: the truth lies in the same file. It is compared with thresholds that take
for rubber what is dark in the phase, or what is low.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from scipy.ndimage import gaussian_filter, median_filter
from sklearn.ensemble import RandomForestClassifier

import phasemap as pm
from phasemap.io.measured import segment_height, segment_phase

TRAINED, TESTED = 18, 6  # of the images below
RUBBER = 1  # its label
SCENE = """
[ensemble]
count = 24
seed = 11
licence = "CC0-1.0"

[ensemble.vary]             # of the scene below
surface.seed = { low = 0, high = 999999, whole = true }
surface.topography.seed = { low = 0, high = 999999, whole = true }
realism.seed = { low = 0, high = 999999, whole = true }
surface.fraction = { low = 0.3, high = 0.6 }
surface.spacing = { low = "50 nm", high = "80 nm" }
materials.glass.modulus = { low = "0.8 GPa", high = "4 GPa", scale = "log" }
materials.glass.damping = { low = 0.005, high = 0.2, scale = "log" }
materials.rubber.modulus = { low = "50 MPa", high = "500 MPa", scale = "log" }
materials.rubber.damping = { low = 0.001, high = 0.05, scale = "log" }
materials.rubber.adhesion = { low = "40 mJ/m2", high = "90 mJ/m2" }
scan.setpoint = { low = 0.6, high = 0.9 }

[scan]
setpoint = 0.7              # amplitude over free amplitude

[control]
kind = "feedback"           # lock-in, PI controller and scanner; gains are tuned
line_rate = 50.0            # [Hz], of 40 pixels: 0.2 ms a pixel

[realism]
temperature = 300.0         # K, of the lever
detector_noise = 1e-12      # m/sqrt(Hz)

[surface]
kind = "blend"              # spinodal decomposition, label 1 takes `fraction` of the image
shape = [40, 40]
pixel_size = 4e-9
spacing = 60e-9
fraction = 0.45
materials = ["glass", "rubber"]
heights = [0.0, -1e-9]      # the rubber has receded
topography = { generator = "roughness", rms = 1.5e-9, correlation_length = 30e-9, seed = 3 }

[materials.glass]
modulus = 2.5e9
adhesion = 0.07             # J/m2
damping = 0.01              # alpha1 of Wang (1999), Eq. 4

[materials.rubber]
modulus = 0.2e9
adhesion = 0.06
damping = 0.03
poisson_ratio = 0.48

[cantilever]                # a usual tapping lever of silicon
stiffness = 40.0            # N/m
resonance_frequency = 300e3 # Hz
quality_factor = 200.0

[tip]
radius = 10e-9

[drive]
free_amplitude = 40e-9      # at resonance

[interaction]
contact = "dmt"
decay_length = 0.3e-9       # of the attraction outside contact
"""


def features(image: xr.Dataset) -> np.ndarray:
    """What a pixel and its neighbours show in trace and retrace, shape (pixels, features)."""
    phase, height = (image[name].mean("direction").to_numpy() for name in ("phase", "height"))
    phase = np.clip(phase, *np.percentile(phase, (2, 98)))  # edges stand out of the phase
    phase, height = (phase - np.median(phase)) / phase.std(), 1e9 * (height - np.median(height))
    along = np.sign(np.corrcoef(median_filter(phase, 5).ravel(), height.ravel())[0, 1])  # -1: what lies low is bright
    error = 1e9 * image.amplitude_error.to_numpy()
    maps = [along * median_filter(phase, width) for width in (1, 3, 5)]
    maps += [gaussian_filter(height, width) for width in (0, 1, 3)]
    maps += [error[0] - error[1], np.hypot(*np.gradient(height))]
    return np.stack([one.ravel() for one in maps], axis=1)


def overlap(found: np.ndarray, truth: np.ndarray) -> float:
    """Mean over both materials of the pixels that are rightly theirs over those that are or were said to be."""
    return float(np.mean([np.sum((found == k) & (truth == k)) / np.sum((found == k) | (truth == k)) for k in (0, 1)]))


def main(folder: Path = Path()) -> None:
    """Write learn_segment.png, the scene learn_segment.toml, and learn_segment.nc."""
    scene = folder / "learn_segment.toml"
    scene.write_text(SCENE)
    ensemble = pm.load_ensemble(scene)
    file = ensemble.simulate(folder / "learn_segment.nc", overwrite=True)
    with xr.open_dataset(file) as opened:
        images = [opened.isel(sample=number).load() for number in range(len(ensemble))]
    seen, unseen = images[:TRAINED], images[TRAINED:]

    forest = RandomForestClassifier(40, min_samples_leaf=50, random_state=0)
    labels = np.concatenate([one.label.to_numpy().ravel() for one in seen])
    forest.fit(np.concatenate([features(one) for one in seen]), labels)
    found = {
        "phase, threshold": [1 - segment_phase(one.phase.mean("direction").values, 2) for one in unseen],
        "height, threshold": [1 - segment_height(one.height.mean("direction").values, 2) for one in unseen],
        "random forest": [forest.predict(features(one)).reshape(one.label.shape) for one in unseen],
    }
    scores = {name: [overlap(*pair) for pair in zip(maps, [one.label.values for one in unseen], strict=True)]
              for name, maps in found.items()}  # fmt: skip
    print(f"overlap with the truth, mean of {TESTED} images that no method has seen:")
    for name, values in scores.items():
        print(f"  {name:<18} {np.mean(values):.2f}, from {min(values):.2f} to {max(values):.2f}")

    figure, panels = plt.subplots(6, TESTED, figsize=(9.5, 9.6), layout="constrained")
    for one, column, number in zip(unseen, panels.T, range(TESTED), strict=True):
        column[0].imshow(one.height[0], cmap="afmhot")
        column[1].imshow(one.phase[0], cmap="cividis")
        column[2].imshow(one.label == RUBBER, cmap="gray_r")
        for axes, (name, maps) in zip(column[3:], found.items(), strict=True):
            axes.imshow(maps[number] == RUBBER, cmap="gray_r")
            axes.set_title(f"{scores[name][number]:.2f}", fontsize=9, pad=2)
        column[0].set_title(f"setpoint {float(one['scan.setpoint']):.2f}", fontsize=9, pad=2)
    for row, name in zip(panels, ("height", "phase", "truth: the rubber", *found), strict=True):
        row[0].set_ylabel(name, fontsize=9)
    for axes in panels.flat:
        axes.set(xticks=[], yticks=[])
    figure.savefig(folder / "learn_segment.png", dpi=150)


if __name__ == "__main__":
    main()
