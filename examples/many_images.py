"""How does one make images for machine learning?

A table [ensemble] in a scene draws materials, setpoints and seeds at random, and writes as many images as wanted into
one file, each with the properties behind it. Here are twelve of the images of samples/ensemble.toml, and a relation
that a program could learn from them: how the phase on the domains depends on their damping.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import phasemap as pm

SCENE = Path(__file__).parent.parent / "samples" / "ensemble.toml"
COUNT = 12


def main(folder: Path = Path()) -> None:
    """Write many_images.png."""
    ensemble = pm.load_ensemble(SCENE, [f"ensemble.count={COUNT}"])
    file = ensemble.simulate(folder / "many_images.nc", overwrite=True)
    with xr.open_dataset(file) as opened:
        images = opened.load()
    dampings, setpoints = images["materials.ldpe.damping"].values, images["scan.setpoint"].values
    phases = images.phase.quantile(0.1, ("y", "x")).values  # LDPE is the darker of both

    figure = plt.figure(figsize=(11.5, 5.0), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.4, 1])
    for axes, phase in zip(left.subplots(3, 4).flat, images.phase, strict=True):
        picture = axes.imshow(phase, cmap="cividis", vmin=0, vmax=60)
        axes.set(xticks=[], yticks=[])
    left.colorbar(picture, ax=left.axes, label="phase (degrees)", shrink=0.8)
    axes = right.subplots()
    for i, setpoint in enumerate(np.unique(setpoints)):
        here = setpoints == setpoint
        axes.plot(dampings[here], phases[here], "os^"[i], label=f"setpoint {setpoint:g}")
    axes.set(xlabel="damping of LDPE (alpha1)", ylabel="phase over LDPE (degrees)")
    axes.legend(frameon=False)
    figure.savefig(folder / "many_images.png", dpi=150)

    print(f"{images.sizes['sample']} images with the properties behind them: {', '.join(ensemble.keys)}")
    linear = np.corrcoef(dampings, phases)[0, 1]
    print(f"phase on LDPE and its damping: correlation {linear:.2f}; modulus and setpoint vary too")


if __name__ == "__main__":
    main()
