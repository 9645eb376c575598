"""Requests of the page to the server, and how they are sent."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable

import numpy as np

from phasemap.explorer.answers import DrawnImage
from phasemap.explorer.limits import compiling, far_off
from phasemap.explorer.offered import Offered, presets
from phasemap.explorer.setting import Setting

JSON = "application/json"
BINARY = "application/octet-stream"
COLOURS = {"height": "afmhot", "phase": "cividis", "contrast": "coolwarm"}

Answer = tuple[str, bytes]


def start(offered: Offered) -> Answer:
    """Beginning of the page: the samples, the presets, and colours."""
    import matplotlib

    colours = {
        name: np.round(255 * matplotlib.colormaps[cmap](np.linspace(0, 1, 256))[:, :3]).astype(int).ravel().tolist()
        for name, cmap in COLOURS.items()
    }
    return JSON, to_json({"samples": offered.names(), "first": offered.first, "presets": presets(), "colours": colours})


def sample(offered: Offered, name: object) -> Answer:
    """Description of a sample for the page, the measured height [nm] and phase [degree] if any, and the labels."""
    subject = offered[name]
    labels = np.ascontiguousarray(subject.sample.labels[:: subject.step, :: subject.step].astype(np.uint8))
    pixel = [subject.step * side for side in subject.pixel_size]
    maps = b""
    if subject.measured is not None:
        maps = b"".join(one.astype(np.float32).tobytes() for one in subject.measured.drawn(subject.step))
    about = {**offered.describe(name), "shape": list(labels.shape), "pixel": pixel, "measured": bool(maps)}
    return BINARY, with_length(to_json(about)) + maps + labels.tobytes()


def open_file(offered: Offered, name: str, content: bytes) -> Answer:
    """The name of the sample that a file of the user's is."""
    return JSON, to_json({"sample": offered.open(name, content)})


def answers() -> dict[str, Callable[[Setting], Answer]]:
    """Questions that can be asked with a setting; those that a slider waits for are in `limits.LIMITS`."""
    from phasemap.explorer import answers
    from phasemap.explorer.saving import SAVED

    def doing(setting: Setting) -> Answer:
        if compiling.going_on:
            text = f"compiling the solvers, only this once: {time.monotonic() - compiling.first:.0f}\u00a0s so far …"
        else:
            text = far_off(setting.scope) or "solving …"
        return JSON, to_json({"doing": text})

    def save(name: str) -> Callable[[Setting], Answer]:
        def saved(setting: Setting) -> Answer:
            file = SAVED[name](setting)
            return BINARY, with_length(to_json({"name": file.name, "kind": file.kind})) + file.content

        return saved

    return {
        "picture": lambda setting: (BINARY, _packed(answers.picture(setting))),
        "scan": lambda setting: (BINARY, _packed(answers.scan(setting))),
        "curves": lambda setting: (JSON, to_json(answers.curves(setting))),
        "contrast": lambda setting: (JSON, to_json(answers.contrast_map(setting))),
        "doing": doing,
        **{f"save/{name}": save(name) for name in SAVED},
    }


def to_json(value: object) -> bytes:
    """JSON that every browser reads."""
    return json.dumps(value, allow_nan=False, ensure_ascii=True).encode()


def with_length(text: bytes) -> bytes:
    """Text with its length before it, which is a multiple of 4."""
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text


def _packed(picture: DrawnImage) -> bytes:
    """A picture: the length of its JSON, the JSON, and two maps of 32-bit floats."""
    return with_length(to_json(picture.about)) + picture.height.tobytes() + picture.phase.tobytes()
