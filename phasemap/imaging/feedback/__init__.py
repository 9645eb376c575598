"""Scans in time: `PAINTER` makes images, `tune` finds gains, `margin` says how far they are from ringing."""

from phasemap.imaging.feedback.painter import PAINTER
from phasemap.imaging.feedback.tuning import margin, tune

__all__ = ["PAINTER", "margin", "tune"]
