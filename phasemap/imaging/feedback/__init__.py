"""Scans in time: `SIMULATOR` makes images, `tune` finds gains, `margin` says how far they are from ringing.

`loop` turns a control into numbers of the feedback loop, `tuning` finds its gains, and `settling` tries them.
`program` cuts a line of the surface into segments, `lines` moves the tip along them, and `simulator` fills an image
line by line; `harmonics` corrects the faster engine for what it leaves out.
"""

from phasemap.imaging.feedback.simulator import SIMULATOR
from phasemap.imaging.feedback.tuning import margin, tune

__all__ = ["SIMULATOR", "margin", "tune"]
