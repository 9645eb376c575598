"""Scans in time: `PAINTER` makes images, `tune` finds gains, `margin` says how far they are from ringing."""

from phasemap.feedback.paint import PAINTER
from phasemap.feedback.tuning import margin, tune

__all__ = ["PAINTER", "margin", "tune"]
