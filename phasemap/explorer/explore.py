"""`phasemap.explore`: the explorer started from Python."""

from __future__ import annotations

import html
import os
import shutil
import sys
import tempfile
import threading
import weakref
import webbrowser
from collections.abc import Callable
from pathlib import Path

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.explorer.offered import Opened, first_of
from phasemap.explorer.server import HOST, Server
from phasemap.explorer.subject import subject_of
from phasemap.scenes.scene import Scene

HEIGHT = 900  # pixels of the frame in a notebook
LEADS = """<!doctype html>
<meta charset="utf-8"><meta http-equiv="refresh" content="0;url={0}"><title>phasemap explorer</title>
<p>The explorer is <a href="{0}">here</a>.</p>
"""


class Explorer:
    """A page that is being served at `url`, its address on this machine, with its token.

    In a notebook it shows the page itself. It is closed by `close`, at the end of a ``with`` block, and with Python.
    """

    def __init__(self, given: Opened | None = None, port: int = 0, fragment: str = "") -> None:
        try:
            self._server = Server(given, port)
        except OSError as error:
            raise PhasemapError(f"cannot serve on {HOST} port {port}: {error.strerror or error}.") from error
        self.url = self._server.url + fragment
        self._forget: Callable[[], object] = lambda: None  # removes the file that leads a browser here
        threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()

    def show(self) -> None:
        """Open the page in the browser.

        All users of this machine can see what a browser is started with. So that is not the address with its token, but
        the name of a file, which only this user can read and which leads there. It is removed when the page is closed.
        """
        try:
            folder = tempfile.mkdtemp(prefix="phasemap-")
            self._forget = weakref.finalize(self._server, shutil.rmtree, folder, ignore_errors=True)
            file = Path(folder, "explorer.html")
            file.touch(0o600)
            file.write_text(LEADS.format(html.escape(self.url)), "utf-8")
        except OSError as error:
            self.close()
            hint = "Open no browser (--no-browser, browser=False), and go to the address that is given."
            raise FileError(f"cannot write a file for the browser: {error.strerror or error}. {hint}") from error
        webbrowser.open(file.as_uri())

    def close(self) -> None:
        """Stop serving; the page says so."""
        self._forget()
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
        return f'<iframe src="{html.escape(self._server.proxied or self.url)}" {more}></iframe>'


@asked_as()
def explore(
    surface_or_scene: Surface | Scene | str | os.PathLike[str] | None = None,
    scope: Microscope | None = None,
    setpoint: float | None = None,
    *,
    port: int = 0,
    browser: bool | None = None,
) -> Explorer:
    """Open a page with a slider for every parameter of the microscope and of the materials.

    It shows height and phase image with histogram and profile, amplitude and phase against the distance with all
    branches, a period of deflection and force, the map of the contrast, and says why the contrast has its sign. What
    was found can be saved as a scene, an image, a picture, or Python.

    Parameters
    ----------
    surface_or_scene : Surface, Scene, str or path-like, optional
        A surface of at most eight materials, a scene or its file, a microscope's file, or the name of a sample
        ("blend"); the page begins with a sample by default, and offers others.
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
    FileError
        If the scene cannot be read, or the file that leads the browser to the page cannot be written.
    PhasemapError
        If the port is taken.

    Notes
    -----
    The page is served on this machine only, under an address that holds a random token, and loads nothing from
    elsewhere. In a notebook on a JupyterHub the browser reaches it if the package jupyter-server-proxy is installed
    there. The browser is led there by a file that only the user can read, which is removed in the end.

    While a slider moves every pixel is engaged anew from far, with the cheapest solver that is within the accuracy, on
    at most 256 x 256 pixels, with ten seconds of computing. What is saved is simulated whole and as the scene says.

    Examples
    --------
    >>> import phasemap as pm
    >>> page = pm.explore("samples/step.toml", browser=False)
    >>> page.url.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    return serve(_given(surface_or_scene, scope, setpoint), port, _no_notebook() if browser is None else browser)


def serve(given: Opened | None = None, port: int = 0, browser: bool = False, fragment: str = "") -> Explorer:
    """Serve the page that begins with `given` and the values of a link's `fragment`, and open the browser if wanted."""
    explorer = Explorer(given, whole("port", port, 0, 65535), fragment)
    if browser:
        explorer.show()
    return explorer


def _given(explored: object, scope: Microscope | None, setpoint: float | None) -> Opened | None:
    """Subject that the user gives to begin with."""
    if explored is None:
        if scope is not None or setpoint is not None:
            raise InputError("surface_or_scene", None, "a Surface or a Scene where scope or setpoint is given")
        return None
    if isinstance(explored, (str, os.PathLike)) and scope is None and setpoint is None:
        return first_of(explored)
    return Opened(subject_of(explored, scope, setpoint))  # type: ignore[arg-type]


def _no_notebook() -> bool:
    """True in a plain Python, which shows no HTML."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return not hasattr(shell, "kernel")
