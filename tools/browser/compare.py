"""Compare the page's answers, in node, with those of Python.

    python tools/browser/compare.py FOLDER

FOLDER: where build.py wrote the pages. Exits with 1 where a phase differs by more than 1e-10 degree, or a status.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cases
import numpy as np

from phasemap.explorer.offered import Offered

LIMIT = 1e-10  # degrees
WAY = 1e-9  # degrees, of points on the way along a curve, which are where a step ends; beside a fold phases are steep
SINGLE = 1e-5  # degrees and nm, of maps in single precision
DIGIT = 0.0101  # a last digit of what is rounded
ALLOWED = {"curves": DIGIT, "contrast": DIGIT, "picture": SINGLE, "save/scene": 0.0}
HERE = Path(__file__).parent


def main(folder: Path) -> None:
    """Compare, and say how far both are apart."""
    said = subprocess.run(
        ["node", HERE / "answer.mjs", folder.resolve()], check=True, stdout=subprocess.PIPE, text=True
    )
    here, there = json.loads(cases.said(Offered().__getitem__)), json.loads(said.stdout.splitlines()[-1])
    failed = False
    status, offset, phase = (apart(*pair) for pair in zip(here["solved"], there["solved"], strict=True))
    print(f"{cases.COUNT} materials: phases within {phase:.1e} degree, tip offsets within {offset:.1e} m")
    failed |= status > 0 or not phase <= LIMIT
    for law, wanted in here["curves"].items():
        way, *rest = (apart(wanted[name], there["curves"][law][name]) for name in wanted if name.endswith("phase"))
        points, pieces = len(wanted["curve_phase"]), 1 + max(wanted["curve_piece"])
        print(f"{law}: a curve of {points} points in {pieces} pieces: {max(rest):.1e} degree, on the way {way:.1e}")
        failed |= not max(rest) <= LIMIT or not way <= WAY
    for (route, name, message), wanted, found in zip(cases.MESSAGES, here["pages"], there["pages"], strict=True):
        far = apart(list(numbers(opened(route, wanted))), list(numbers(opened(route, found))))
        print(f"{route} of {name} {message}: within {far:.1e}")
        failed |= not far <= ALLOWED[route]
    for asked, file in json.loads((folder / "prepared.json").read_text()).items():
        route, message = asked.split(" ", 1)
        given = json.loads(message)
        wanted = cases.answered(route, Offered()[given.pop("sample")], given)
        far = apart(*(list(numbers(opened(route, one))) for one in (wanted, prepared(folder / file))))
        print(f"{file}, made with the page: within {far:.1e}")
        failed |= not far <= ALLOWED[route]
    sys.exit(int(failed))


def prepared(file: Path) -> str:
    """An answer that was made with the page."""
    return base64.b64encode(gzip.decompress(file.read_bytes())).decode()


def apart(one: list[float], other: list[float]) -> float:
    """The largest difference; infinite where one of both is not a number, or there are more of them."""
    if len(one) != len(other):
        return math.inf
    a, b = np.array(one, float), np.array(other, float)
    known = np.isfinite(a)
    if (known != np.isfinite(b)).any():
        return math.inf
    return float(np.abs(a - b)[known].max(initial=0.0))


def opened(route: str, answer: str) -> Any:
    """An answer as the page reads it."""
    content = base64.b64decode(answer)
    if route in ("curves", "contrast"):
        return json.loads(content)
    (length,) = struct.unpack_from("<I", content)
    rest = content[4 + length :]
    maps = np.frombuffer(rest, np.float32).tolist() if route == "picture" else rest.decode().splitlines()
    return [json.loads(content[4 : 4 + length]), maps]


def numbers(said: Any) -> Iterator[float]:
    """All numbers of an answer; words count as 0 where both have the same, which `apart` sees by their digests."""
    if isinstance(said, dict):
        said = [part for item in said.items() for part in item]
    if isinstance(said, list):
        for part in said:
            yield from numbers(part)
    elif isinstance(said, str):
        yield float(sum(map(ord, said)))
    else:
        yield math.nan if said is None else float(said)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
