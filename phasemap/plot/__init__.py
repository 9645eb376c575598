"""Pictures: of an image, a comparison of two, a sweep, one of its periods, and the contrast between materials.

`plot`, in `images`, looks at what a Dataset holds and calls the function for it. Each kind of picture has a file of its
own, and all are drawn on a `page`, with `colours` for all. A picture is drawn from the Dataset alone, with matplotlib's
Figure and without pyplot: nothing is shown, no global state is touched, and start-up stays short.
"""

from phasemap.plot.contrasts import contrast
from phasemap.plot.curves import fit, force, trace
from phasemap.plot.images import plot
from phasemap.plot.images import plot as image
from phasemap.plot.materials import inversion
from phasemap.plot.series import series
from phasemap.plot.side_by_side import comparison
from phasemap.plot.sweep import curve

__all__ = ["comparison", "contrast", "curve", "fit", "force", "image", "inversion", "plot", "series", "trace"]


def __dir__() -> list[str]:
    """The functions that draw, without the modules that they are in."""
    return __all__
