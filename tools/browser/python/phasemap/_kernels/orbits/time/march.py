"""The march over surfaces that remember, by its place in WebAssembly's table of functions."""

from __future__ import annotations

import compiled


def address_of_relaxing():
    """As of a formula."""
    return compiled.place_of(address_of_relaxing)
