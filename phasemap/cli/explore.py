"""The command ``phasemap explore``: a page of sliders, served to a browser on this machine."""

from __future__ import annotations

import argparse
import sys
import threading

from phasemap._shared.interrupts import ending_at_once, leave
from phasemap.cli.arguments import add_overrides

EXAMPLES = """examples:
  phasemap explore
  phasemap explore bistable scan.setpoint=0.7 tip.radius=20nm
  phasemap explore scene.toml --no-browser --port 8765
  phasemap explore MoS2.nid tip.radius=10nm drive.free_amplitude=40nm
  phasemap explore "http://127.0.0.1:8765/...#sample=blend&scan.setpoint=0.6"

The page is served on this machine only (127.0.0.1), under an address that nobody can guess, until Ctrl-C.
"""
SWITCH = 5e-4  # seconds that a thread keeps Python to itself, so that no long answer holds up a slider
GRACE = 0.5  # seconds that an answer which is being made has to end


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    about = "scene file, microscope's file, name of a sample, or a link of the page; default: a sample"
    parser.add_argument("scene", metavar="WHAT", nargs="?", help=about)
    add_overrides(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address only")
    parser.add_argument("--port", type=_port, metavar="N", default=0, help="port of the page; default: any free one")


def explore(arguments: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C."""
    sys.setswitchinterval(SWITCH)
    with ending_at_once("the explorer had not started"):
        from phasemap.explorer.explore import serve
        from phasemap.explorer.offered import SAMPLES, first_of

        what, hash_, fragment = (arguments.scene or "").partition("#")
        if what.startswith("http") or "=" in what:  # a link holds everything; without a scene an override comes first
            arguments.overrides = [what] * ("=" in what) + arguments.overrides
            what = ""
        given = first_of(what or SAMPLES[0], arguments.overrides) if what or arguments.overrides else None
        explorer = serve(given, arguments.port, not arguments.no_browser, hash_ + fragment)
    try:
        print(f"the explorer is at {explorer.url}\nCtrl-C ends it.", flush=True)
        threading.Event().wait()
    except KeyboardInterrupt:
        print("\nphasemap: the explorer is closed.")
    finally:
        explorer.close()
        if not explorer.idle.wait(GRACE):
            leave(explorer.idle)


def _port(text: str) -> int:
    """A number of a port."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, a whole number from 0 to 65535")
    return int(text)
