"""The commands ``phasemap run``, which simulates a scene or an ensemble, and ``validate``, which checks it."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import PhasemapError
from phasemap._shared.fields import values_in_words
from phasemap._shared.interrupts import ending_at_once, interruptible
from phasemap._shared.notices import unquestioned, untold
from phasemap._shared.threads import workers_of
from phasemap._shared.units import ELECTRONVOLT, counted, image_size, say
from phasemap.cli.arguments import add_files, add_options, add_scene, whole_number
from phasemap.cli.console import bar_of, progress_bar, remarks
from phasemap.experiment.material import Material

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.microscope import Microscope
    from phasemap.scenes.ensemble import Ensemble
    from phasemap.scenes.scene import Scene

EXAMPLES = """examples:
  phasemap run samples/blend.toml -o blend.nc
  phasemap run samples/blend.toml -o blend.nc --overwrite materials.ldpe.modulus=0.3e9
  phasemap run samples/step.toml -o step.nc scan.solver=march --threads 1
  phasemap run samples/ensemble.toml -o ensemble.nc ensemble.count=1000 --workers 4

A scene with a table [ensemble] is simulated in all its variants, into a file that holds the truth behind each image
too. After an interrupt the same command goes on.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``phasemap run``."""
    add_scene(parser)
    add_files(parser, "file to write; default: [output] file", plot=None)
    add_options(parser, "quiet", "threads")
    parser.add_argument(
        "--workers", type=whole_number, metavar="N", help="processes for an ensemble; default: all cores"
    )
    parser.add_argument("--strict", action="store_true", help="stop at the first pixel without a solution")
    add_options(parser, "strict-units")


def add_validate(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``phasemap validate``."""
    add_scene(parser)
    add_options(parser, "strict-units")


def run(arguments: argparse.Namespace) -> None:
    """Simulate a scene into a file."""
    started = time.perf_counter()
    with ending_at_once():
        from phasemap.imaging.checkpoint import discard
        from phasemap.io.netcdf import check_dataset, save
        from phasemap.scenes.scene import load_scene

        ensemble = _ensemble_of(arguments)
        if ensemble is None:
            if arguments.workers:
                raise PhasemapError("--workers is for an ensemble; one image takes --threads.")
            scene = load_scene(arguments.scene, arguments.overrides)
            output = check_dataset(_output_of(arguments, scene), arguments.overwrite)
    if ensemble is not None:
        run_ensemble(arguments, ensemble, _output_of(arguments, ensemble))
        return
    parts = output.with_name(f"{output.name}.parts")
    try:
        image = interruptible(lambda: _simulated(scene, arguments, parts))
        interruptible(lambda: save(image, output, arguments.overwrite))
    except KeyboardInterrupt:
        kept = f"what is done is kept in {parts}; run the same command again to go on"
        raise KeyboardInterrupt(kept if parts.exists() else "") from None
    with ending_at_once(f"the image is in {output}"):
        discard(parts)
        if not arguments.quiet:
            _print_summary(scene, image)
            print(f"took        {time.perf_counter() - started:.2f} s\nwritten to  {output}")


def _simulated(scene: Scene, arguments: argparse.Namespace, parts: Path) -> xr.Dataset:
    """The image, with a bar on stderr."""
    unit = " lines" if scene.options["control"].in_time else " materials"
    with progress_bar(unit, arguments.quiet) as progress, nullcontext() if arguments.quiet else untold():
        return scene.simulate(strict=arguments.strict, threads=arguments.threads, checkpoint=parts, progress=progress)


def validate(arguments: argparse.Namespace) -> None:
    """Print what a scene would simulate."""
    import numpy as np

    from phasemap.imaging.simulation import check_job, modelled
    from phasemap.scenes.scene import load_scene
    from phasemap.solvers.problem import make_work

    ensemble = _ensemble_of(arguments)
    if ensemble is None:
        scene = load_scene(arguments.scene, arguments.overrides)
    else:
        ensemble.check()
        print_ensemble(ensemble)
        print("the first sample:")
        scene = ensemble.scene(0)
    surface, scope = scene.surface, scene.microscope
    check_job(surface, scope, **scene.options)
    materials = surface.unique()[0]
    amplitude = scene.options["setpoint"] * scope.driven_amplitude
    viscous, amplitudes = surface.viscosity is not None, np.full(len(materials), amplitude)
    work = make_work(materials, viscous, scope, amplitudes, marched=True)
    _print_scene(scene, "; ".join(modelled(work, scope, surface.topography is not None, work.law.memory != 0)))
    print(f"output      {scene.output or 'to be named with -o'}")
    print("The scene is valid.")


def _ensemble_of(arguments: argparse.Namespace) -> Ensemble | None:
    """The ensemble that a scene file is; None if it is one scene."""
    from phasemap.scenes.ensemble import is_ensemble, load_ensemble

    if not is_ensemble(arguments.scene, arguments.overrides):
        return None
    return load_ensemble(arguments.scene, arguments.overrides)


def _output_of(arguments: argparse.Namespace, scene: Scene | Ensemble) -> Path:
    """File to write: that of the command, or else that of the scene."""
    if arguments.output is not None:
        return Path(arguments.output)
    if scene.output is None:
        raise PhasemapError("the output has no name: give -o OUT.nc, or file under [output] in the scene.")
    return scene.output


def _print_scene(scene: Scene, modelled: str) -> None:
    """Print the size, the materials, and the forces between them and the tip."""
    print(f"image       {image_size(scene.surface.shape, scene.surface.pixel_size)}")
    print(f"materials   {len(scene.surface.unique()[0])} distinct")
    built = scene.built
    used = set() if built is None or built.labels is None else built.labels.used
    with unquestioned():  # who wrote the scene was told when it was read
        for name, numbers in scene.config["materials"].items():
            print(f"{name:<12}{values_in_words(Material(**numbers))}{'' if name in used else '; in no pixel'}")
    print(f"lever       {values_in_words(scene.microscope.cantilever)}")
    print(f"modelled    {modelled}")
    print(f"setpoint    {scene.options['setpoint']:g} of {_free_in_words(scene.microscope)}")
    print(f"solver      {scene.options['solver']}")
    if control := str(scene.options["control"]):
        print(f"control     {control}")
    if realism := str(scene.options["realism"]):
        print(f"realism     {realism}")


def _free_in_words(scope: Microscope) -> str:
    """The free amplitude that the setpoint is of, and why it is not that of the scene, where it is another."""
    seen, alone = say(scope.driven_amplitude, "m"), say(scope.drive.free_amplitude, "m")
    if seen == alone:
        return seen
    alone = f"(free_amplitude, {alone}, is its first mode's at resonance)"
    return f"{seen}, which the free lever shows at the drive frequency {alone}"


def _in_words(notes: Mapping[str, Any], noisy: bool) -> str:
    """Gains of a feedback and their margin of stability."""
    from phasemap.imaging.feedback.tuning import MOST_MARGIN

    gains = f"Kp {notes['proportional_gain']:.3g}, Ki {notes['integral_gain_per_second']:.4g} 1/s"
    factor = notes["gain_margin"]
    rings = "unstable: lower the gains" if factor < 1 else f"stable up to {factor:.3g} times these gains"
    if factor >= MOST_MARGIN:
        rings = "never rings, not even at a million times these gains"
    if factor != factor:
        rings = "stability limit not known"
    if notes["ringing_lines"] and not noisy:  # noise leaves no feedback at rest
        lower = ", with any gains tried" if notes["restless_materials"] else ": lower the gains"
        rings = f"still oscillating at the start of {notes['ringing_lines']} lines{lower}"
    if notes["gains_lowered"] > 1:
        rings += f"; gains lowered by a factor of {notes['gains_lowered']:g}"
    return f"{gains}; {rings}; {notes['periods_per_pixel']:.4g} periods per pixel"


def _print_summary(scene: Scene, image: xr.Dataset) -> None:
    """Print a summary of the scene and of the simulated image."""
    import numpy as np

    from phasemap.results.descriptions import describe_alike, describe_flags, describe_solvers

    _print_scene(scene, image.attrs["modelled"])
    realism = scene.options["realism"]
    noisy = realism.temperature is not None or realism.detector_noise is not None
    if "gain_margin" in image.attrs:
        print(f"feedback    {_in_words(image.attrs, noisy)}")
    if "solver" in image:
        print(f"solved by   {describe_solvers(image['solver'])}")
    if "branch" in image:
        print(f"regime      {describe_flags(image['branch'])}")
    above = "nm above the lowest pixel"
    shown = (("phase", "degrees", 1.0), ("height", above, 1e9), ("dissipation", "eV per cycle", 1 / ELECTRONVOLT))
    for name, unit, factor in shown:
        if name in image:
            values: Any = image[name].values[np.isfinite(image[name].values)] * factor
            values = values - values.min(initial=np.inf) if name == "height" else values
            print(f"{name:<12}" + (f"{values.min():.4g} to {values.max():.4g} {unit}" if values.size else "none found"))
    for line in [] if noisy else describe_alike(image, len(scene.surface.unique()[0])):
        print(f"alike       {line}")
    print("\n".join(remarks(image)))


FEW = 6  # values that are listed


def run_ensemble(arguments: argparse.Namespace, ensemble: Ensemble, output: Path) -> None:
    """Simulate an ensemble into a file; Ctrl-C says what is kept."""
    if arguments.threads or arguments.strict:
        option = "--threads" if arguments.threads else "--strict"
        raise PhasemapError(f"{option} is for one image; an ensemble takes --workers, and its file counts what failed.")
    started, workers = time.perf_counter(), workers_of(arguments.workers)
    with _counting_samples(output, arguments.quiet) as progress:
        ensemble.simulate(output, workers=workers, overwrite=arguments.overwrite, progress=progress)
    if arguments.quiet:
        return
    with ending_at_once(f"the images are in {output}"):
        print_ensemble(ensemble)
        if (irregular := _count(output, "irregular")) != "none":
            print(f"motion      {irregular} irregular")
        print(f"failed      {_count(output, 'failed')}")
        print(f"took        {time.perf_counter() - started:.2f} s")
        print(f"written to  {output}")


def print_ensemble(ensemble: Ensemble) -> None:
    """Print how many samples there are, and the range of each varied key."""
    print(f"samples     {len(ensemble)}")
    for key in ensemble.keys:
        values = [sample[key] for sample in ensemble.samples]
        if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
            values_in_words = f"{min(values):.6g} to {max(values):.6g}"
        else:
            words = sorted({str(value) for value in values})
            values_in_words = ", ".join(words) if len(words) <= FEW else f"{len(words)} values, such as {words[0]}"
        print(f"varied      {key}: {values_in_words}")


@contextmanager
def _counting_samples(output: Path, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Function of progress, which draws a bar on stderr unless that is not wanted; Ctrl-C says what is kept."""
    kept = "nothing was written"
    with nullcontext() if quiet else bar_of(" samples") as bar:

        def progress(done: int, total: int) -> None:
            nonlocal kept
            if done:
                kept = f"{done} of {total} samples are kept in {output}.parts; run the same command again to go on"
            if bar is None:
                return
            if bar.total is None:  # the first call says what an earlier run has done
                bar.total, bar.initial = total, done
                if done:
                    print(f"phasemap: {done} of {total} samples were done already.", file=sys.stderr)
            bar.update(done - bar.n)

        try:
            yield progress
        except KeyboardInterrupt:
            raise KeyboardInterrupt(kept) from None


def _count(output: Path, name: str) -> str:
    """Number of pixels that "failed" or are "irregular", and of samples that have some, in words."""
    import numpy as np
    import xarray as xr

    with xr.open_dataset(output, engine="netcdf4") as ds:
        counts, pixels = ds[name].values if name in ds else np.zeros(1), ds["status"].size
    count = int(counts.sum())
    if not count:
        return "none"
    return f"{counted(count, pixels, 'pixels')}, in {int((counts > 0).sum())} samples"
