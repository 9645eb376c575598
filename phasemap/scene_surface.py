"""The ``[surface]`` table of a scene.

``kind`` says where the surface comes from:

* ``"labels"``: ``labels`` (a map of whole numbers), ``materials`` (names, one for each label from 0, or a table
  ``{ 7 = "soft" }``), ``pixel_size``, ``topography``
* ``"maps"``: ``modulus``, ``adhesion``, ``damping`` or ``viscosity``, ``poisson_ratio``, ``topography`` (numbers or maps),
  ``pixel_size``; or ``file``, a netCDF file that has them all
* ``"measured"``: ``file`` of a measured image, ``materials`` (names, from the lowest phase to the highest), and where the
  file has several ``height`` and ``phase`` channels their names
* the name of a generator of `phasemap.generate`, with its arguments

A map is written as rows of numbers, as the name of a ``.npy``, ``.csv`` or ``.txt`` file, or as
``{ file = "maps.nc", variable = "E" }``. Files are relative to the scene's folder; ``"package:NAME/path"`` is a file that an
installed package brings along.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap.errors import FileError, InputError
from phasemap.material import Material

if TYPE_CHECKING:
    import numpy as np

    from phasemap.surface import Surface
