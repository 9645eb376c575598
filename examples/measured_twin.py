"""How much of a measured phase image does the model explain?

A flake of MoS2 on its substrate, recorded with a Nanosurf instrument (an example file of the package nsfopen), becomes
a scene: settings from the file, topography from the height, materials from the two populations of the phase. This twin
is scanned in time at the recorded line rate and compared with the measurement. Values that the file does not contain
are assumed in the script.
"""

from importlib.util import find_spec
from pathlib import Path

import phasemap as pm
from phasemap.comparison.findings import verdict_of

LINES = slice(96, 160)  # of 256, below the change of the tip
ASSUMED = (
    "tip.radius=10e-9",  # as new
    "drive.free_amplitude=40e-9",  # the file has 250 mV and no calibration
    "cantilever.quality_factor=450",  # the file has a catalogue's
    # Nobody measured these; they are chosen so that flake and substrate differ by the measured 21 degrees.
    "materials.material_0.modulus=1e9", "materials.material_0.adhesion=0.10", "materials.material_0.damping=0.06",
    "materials.material_1.modulus=3e9", "materials.material_1.adhesion=0.10", "materials.material_1.damping=0.01",
)  # fmt: skip


def main(folder: Path = Path()) -> None:
    """Write measured_twin.png, and the scene measured_twin.toml with its maps."""
    package = find_spec("NSFopen")
    assert package is not None and package.origin is not None, "pip install nsfopen"
    measured = pm.read_image(Path(package.origin).parent / "example" / "Plotting_Data" / "MoS2.nid").isel(y=LINES)
    scene = pm.scene_from(measured, folder / "measured_twin.toml", 2, ASSUMED, overwrite=True)
    print(f"recorded: setpoint {measured.attrs['setpoint']:g}, line rate {measured.attrs['line_rate']:.3g} Hz")

    control = pm.Feedback(line_rate=measured.attrs["line_rate"])
    noise = pm.Realism(phase_offset=0.13, seed=1)  # degree, as lines of a homogeneous sample differ
    twin = pm.simulate(scene.surface, scene.microscope, scene.options["setpoint"], control=control, realism=noise)
    found = pm.compare(measured, twin, direction=("trace", "trace"), names=("measured", "simulated"))
    pm.plot.comparison(found, folder / "measured_twin.png", overwrite=True)
    print(verdict_of(found))
    share = 100 * float(found["region_share_of_variance"])
    print(f"The map of materials was read from the phase itself: two regions explain {share:.0f} % of its variance.")
    print("The model adds the size of the contrast, and the effects of topography and feedback.")

    other = pm.compare(measured, measured, direction=("trace", "retrace"), names=("trace", "retrace"))
    best = 100 * float(other["explained"])
    print(f"The measured retrace explains {best:.0f} % of the measured trace; no model can do better.")


if __name__ == "__main__":
    main()
