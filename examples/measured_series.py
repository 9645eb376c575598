"""Why does the contrast invert in a series of files that say hardly anything about the settings?

Four files of one blend as an instrument might have written them: setpoints in volts, another zero of the phase in every
file, a phase that counts the lag, and every file from another place on the sample. Regions are found in each file by
their height; materials, free amplitude, zeros and sign are all unknowns. The result shows what can be relied on: the
order and the sign of the contrast, and which region changes its regime where the contrast inverts. The magnitude is
fitted too, but with four contrasts for eight unknowns this means little, and the page says so.
"""

from pathlib import Path

import numpy as np
import xarray as xr

import phasemap as pm

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
MATRIX = pm.Material(3.0e9, adhesion=0.15, damping=0.004)  # repels the tip below a setpoint of 0.6 only
DOMAIN = pm.Material(0.4e9, adhesion=0.02, damping=0.05)  # always does
SETPOINTS = (0.9, 0.75, 0.6, 0.45)
FREE_VOLTS, SHAPE, PIXEL = 1.3, (96, 96), 4e-9


def measure(setpoint: float, place: int) -> xr.Dataset:
    """One file."""
    rng = np.random.default_rng(place)
    labels = pm.generate.blend(SHAPE, PIXEL, spacing=100e-9, fraction=0.35, seed=place)
    relief = 6e-9 * labels
    surface = pm.Surface.from_labels(labels, {0: MATRIX, 1: DOMAIN}, pixel_size=PIXEL, topography=relief)
    image = pm.simulate(surface, SCOPE, setpoint, "averaging", variables=["phase", "height"])
    drift = rng.normal(0, 1.0, (SHAPE[0], 1))
    phase = -image.phase + rng.uniform(-180, 180) + drift + rng.normal(0, 1.5, SHAPE)
    height = image.height + 0.02 * image.x + rng.normal(0, 2e-10, SHAPE)
    said = {"setpoint_voltage": setpoint * FREE_VOLTS, "drive_frequency": 300e3, "title": f"film.00{place}"}
    return xr.Dataset({"phase": phase, "height": height}, attrs=said)


def main(folder: Path = Path()) -> None:
    """Write measured_series.png."""
    files = [measure(setpoint, place) for place, setpoint in enumerate(SETPOINTS, 1)]
    found = pm.series(files, SCOPE, by="height", sign=-1)
    for word in ("notes", "verdict", "advice"):
        print(f"{word}:", *found.attrs[word].splitlines(), sep="\n  ")
    pm.plot.series(found, folder / "measured_series.png", overwrite=True)


if __name__ == "__main__":
    main()
