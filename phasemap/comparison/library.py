"""scikit-image, which only comparing needs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from phasemap._shared.errors import PhasemapError


def skimage(module: str, purpose: str) -> Any:
    """Import a module of scikit-image.

    `module`: below ``skimage``.
    `purpose`: what needs it, as the beginning of a sentence.
    Raises PhasemapError if it is not installed.
    """
    try:
        return import_module(f"skimage.{module}")
    except ImportError as error:
        raise PhasemapError(f'{purpose} needs scikit-image: run pip install "afm-phasemap[compare]".') from error
