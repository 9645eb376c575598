"""A relaxation spectrum as contacts feel it: arms of one solid with the tip in series, reduced to those that act."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import MOST_ARMS
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.prony import Prony, arms_at, spectrum_of

FASTEST_SEEN = 30.0  # drive frequencies up to which a tap hears: half of it lasts for a sixtieth of the period or more
REDUCED = 1e-4  # largest error of the complex modulus up to there that merging arms may make, over its size
SHORTENED = np.geomspace(1.0, 1e6, 400)  # by which the time of slow arms that are one may be shorter
_TABLES: dict[float, Array] = {}
"""Tables by the addresses at which kernels find them, for as long as the process lasts."""


class Contact(NamedTuple):
    """A spectrum under a tip."""

    stiffness: float  # of a sudden touch, over that of all arms [1]
    time: float  # 1 - `share` over the slowest recovery [s]; 0 where nothing relaxes
    share: float  # 1 - K_inf/K_0 [1]
    address: float  # of its arms, as `phasemap._kernels.orbits.time.arms` reads them


def merged(prony: Prony, frequency: float) -> Prony:
    """The spectrum at a drive frequency [Hz]: arms slower than the dwell are springs, fast arms are one, slow ones too.

    A motion that repeats itself knows the complex modulus at multiples of that frequency only, and in the mean what is
    left of it, which stays. The fast arm has the sums of E tau and E tau^2 of those that it stands for, so that what
    it changes goes with the third power of omega tau; the slow one has their sum of E, and the shortest time with which
    it keeps to `REDUCED`, for dents last as long as the slowest arm. Each changes the modulus by that at most, over
    its size, up to `FASTEST_SEEN`.
    """
    pairs: dict[float, float] = {}
    for time, modulus in sorted(zip(prony.times, prony.moduli, strict=True)):
        if modulus > 0 and not (prony.dwell is not None and time > prony.dwell):
            pairs[time] = pairs.get(time, 0.0) + modulus
    if not pairs:
        return Prony([0.0], [1.0], prony.lasting)  # type: ignore[arg-type]
    times, moduli = np.array(list(pairs)), np.array(list(pairs.values()))
    frequencies = np.geomspace(frequency, FASTEST_SEEN * frequency, 30)
    parts = moduli * arms_at(frequencies, times)
    size = np.abs(prony.lasting + parts.sum(axis=1))

    def off(of: slice, time: float, modulus: float) -> float:
        arm = modulus * arms_at(frequencies, np.array([time]))[:, 0]
        return float(np.max(np.abs(arm - parts[:, of].sum(axis=1)) / size))

    fast, kept = 0, (times, moduli)
    for count in range(2, len(times) + 1):
        first, second = float(np.sum((moduli * times)[:count])), float(np.sum((moduli * times**2)[:count]))
        if off(slice(count), second / first, first**2 / second) > REDUCED:
            break
        fast = count
        kept = np.append(second / first, times[count:]), np.append(first**2 / second, moduli[count:])
    times, moduli = kept
    for count in range(1, len(pairs) - fast + 1):
        modulus, of = float(np.sum(moduli[-count:])), slice(len(pairs) - count, None)
        longest = modulus / float(np.sum((moduli / times)[-count:]))
        if off(of, longest, modulus) > REDUCED:
            break
        shortest = min(time for time in longest / SHORTENED if off(of, time, modulus) <= REDUCED)
        kept = np.append(times[:-count], shortest), np.append(moduli[:-count], modulus)
    return Prony(kept[1], kept[0], prony.lasting)  # type: ignore[arg-type]


@cache
def contact_of(key: float, compliance: float, frequency: float, unit: float) -> Contact:
    """A spectrum under a tip and a drive.

    `compliance`: of the tip, over that of the surface per modulus [1/Pa]: E_s times it is 0 for a rigid tip.
    `frequency`: of the drive [Hz]; `unit`: of rates in the table [rad/s].
    """
    whole = spectrum_of(key)
    prony = merged(whole, frequency)
    first = prony.instantaneous
    share, rate = np.array(prony.moduli) / first, 1 / np.array(prony.times)
    # An elastic tip in series leaves the rates alone at which dents recover, and takes its part of what they weigh.
    g = np.sqrt(share * rate)
    recovery, turned = np.linalg.eigh(np.diag(rate) - np.outer(g, g))
    series = 1 + first * compliance
    weight = turned.T @ g / math.sqrt(series)
    rate, back = np.linalg.eigh(np.diag(recovery) + np.outer(weight, weight))
    rate, back = rate[::-1], back[:, ::-1]  # the fastest first
    share = (back.T @ weight) ** 2 / rate
    stiffness = first / series / (whole.instantaneous / (1 + whole.instantaneous * compliance))
    if not share.sum() > 0:
        return Contact(stiffness, 0.0, 0.0, 0.0)
    if len(rate) > MOST_ARMS:
        allowed = f"at most {MOST_ARMS} relaxation times that a tap sees"
        raise InputError(
            "relaxation", Word(f"{len(rate)} relaxation times"), allowed, "Give dwell, or a fit of fewer arms."
        )
    kappa = float(share.sum())
    time = (1 - kappa) / float(recovery[0])
    if len(rate) == 1:
        return Contact(stiffness, time, kappa, 0.0)
    to_arms = 1 / (1 - recovery[None, :] / rate[:, None])
    to_dents = np.linalg.inv(to_arms)
    table = np.concatenate([[len(rate)], share, rate / unit, recovery / unit, to_arms.ravel(), to_dents.ravel()])
    address = float(table.ctypes.data)
    _TABLES[address] = table
    return Contact(stiffness, time, kappa, address)


def most_arms(relaxation: Array) -> int:
    """Largest number of arms among spectra of `phasemap.experiment.material_rows.relaxation_of`."""
    return max((int(_TABLES[address][0]) for address in np.unique(relaxation[:, 2]) if address), default=1)
