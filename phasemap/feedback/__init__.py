"""Scans in time: `paint` fills a canvas, `tune` finds gains, `margin` says how far they are from ringing."""

from phasemap.feedback.paint import paint
from phasemap.feedback.tuning import margin, tune

__all__ = ["margin", "paint", "tune"]
