"""`phasemap.explore`: the explorer started from Python."""

from __future__ import annotations

import html
import os
import threading
from typing import TYPE_CHECKING

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import PhasemapError

if TYPE_CHECKING:
    from phasemap.experiment.microscope import Microscope
    from phasemap.experiment.surface import Surface
    from phasemap.explorer.subject import Subject
    from phasemap.scenes.scene import Scene

HEIGHT = 900  # pixels of the frame in a notebook


class Explorer:
    """A page that is being served.

    In a notebook it shows the page itself. It is closed by `close`, at the end of a ``with`` block, and with Python.

    Attributes
    ----------
    url : str
        Address of the page on this machine, with its token.
    """

    def __init__(self, subject: Subject, port: int = 0) -> None:
        from phasemap.explorer.server import HOST, Server

        try:
            self._server = Server(subject, port)
        except OSError as error:
            raise PhasemapError(f"cannot serve on {HOST} port {port}: {error.strerror or error}.") from error
        self.url = self._server.url
        threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()

    def close(self) -> None:
        """Stop serving; the page says so."""
        if not self._server.closing:
            self._server.closing = True
            self._server.shutdown()
            self._server.server_close()

    @property
    def idle(self) -> threading.Event:
        """Set while no answer is being made."""
        return self._server.busy.none

    def __enter__(self) -> Explorer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Explorer({'closed' if self._server.closing else self.url})"

    def _repr_html_(self) -> str:
        """The page in a frame."""
        if self._server.closing:
            return "<p>This explorer is closed.</p>"
        more = f'width="100%" height="{HEIGHT}" style="border: 0" allow="clipboard-write"'
        return f'<iframe src="{html.escape(self.url)}" {more}></iframe>'


@asked_as()
def explore(
    surface_or_scene: Surface | Scene | str | os.PathLike[str],
    scope: Microscope | None = None,
    setpoint: float | None = None,
    *,
    port: int = 0,
    browser: bool | None = None,
) -> Explorer:
    """Open a page with a slider for every knob of the microscope and of the materials.

    It shows height and phase image with histogram and profile, amplitude and phase against the distance with all
    branches, a period of deflection and force, the map of the contrast, and says why the contrast has its sign. What
    was found can be saved as a scene, an image, a picture, or Python.

    Parameters
    ----------
    surface_or_scene : Surface, Scene or path-like
        A surface of at most eight materials, or a scene or its file.
    scope : Microscope, optional
        For a surface; a scene has its own.
    setpoint : float, optional
        To begin with; that of the scene by default, 0.7 for a surface.
    port : int
        Of the server on 127.0.0.1; 0 is any that is free.
    browser : bool, optional
        Whether to open the page in the browser; by default it is where Python runs in no notebook, which shows the page
        itself.

    Returns
    -------
    Explorer
        With ``url`` and ``close()``; the page works as long as Python runs, or until it is closed.

    Raises
    ------
    InputError
        If an argument is out of range, or there are more than eight materials.
    FileError
        If the scene cannot be read.
    PhasemapError
        If the port is taken.

    Notes
    -----
    The page is served on this machine only, under an address that holds a random token, and loads nothing from
    elsewhere. In a notebook that runs on another machine the browser does not reach it.

    While a slider moves every pixel is engaged anew from far, with the cheapest solver that is within the accuracy, on
    at most 256 x 256 pixels. What is saved is simulated whole and as the scene says.

    Examples
    --------
    >>> import phasemap as pm
    >>> page = pm.explore("samples/step.toml", browser=False)
    >>> page.url.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    from phasemap.explorer.subject import subject_of

    return serve(subject_of(surface_or_scene, scope, setpoint), port, _no_notebook() if browser is None else browser)


def serve(subject: Subject, port: int = 0, browser: bool = False) -> Explorer:
    """Serve a subject, and show it in the browser if that is wanted.

    Raises
    ------
    InputError, PhasemapError
        As `explore`.
    """
    explorer = Explorer(subject, whole("port", port, 0, 65535))
    if browser:
        import webbrowser

        webbrowser.open(explorer.url)
    return explorer


def _no_notebook() -> bool:
    """Whether this is a plain Python, which shows no HTML."""
    import sys

    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return not hasattr(shell, "kernel")
