"""Scans in time: `SIMULATOR` makes images, `tune` finds gains, `margin` says how far they are from ringing."""

from phasemap.imaging.feedback.simulator import SIMULATOR
from phasemap.imaging.feedback.tuning import margin, tune

__all__ = ["SIMULATOR", "margin", "tune"]
