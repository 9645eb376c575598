"""Derived channels of an image: against its other variables, and against what another solver found."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from phasemap._shared.arrays import Array
from phasemap.results.channels import channels
from phasemap.results.quantities import CHANNELS, Channel, motion_of
from phasemap.results.variables import FLOATS, OF_ADHESION
from phasemap.validation.checking.again import Again
from phasemap.validation.checking.picture import Picture
from phasemap.validation.checking.result import Claim, judged

ROUNDING = 1e-9  # of a channel that is computed from the same numbers again


def derived_in(picture: Picture) -> list[Channel]:
    """The channels of an image that are not variables of images anyway."""
    return [channel for name, channel in CHANNELS.items() if name in picture and name not in FLOATS]


def follows(picture: Picture) -> Claim | None:
    """Judge whether channels are what their formulas make of the image's other variables; None without such."""
    made = [
        channel.name
        for channel in derived_in(picture)
        if picture.has("phase", *channel.needs, *filter(None, [channel.of_orbit]))
    ]
    if not made:
        return None
    again = channels(picture.image, made, scope=picture.claims.microscope)
    bad, share = np.zeros(picture.shape, bool), np.zeros(picture.shape)
    for name in made:
        value, claimed = again[name].values.reshape(picture.shape), picture.raw(name)
        same = (np.abs(claimed - value) <= ROUNDING * np.abs(value)) | (np.isnan(claimed) & np.isnan(value))
        bad |= ~same
        share = np.fmax(share, np.abs(np.nan_to_num(claimed - value)))
    about = "derived channels follow from the other variables"
    return judged(about, picture, bad, share, picture.good, ", ".join(made))


def solved_again(picture: Picture, again: Again, largest: Mapping[str, Array]) -> dict[str, tuple[Array, Array, Array]]:
    """Channels of one mode, of sampled pixels: as in the image, as found again, and how far apart they may be.

    That is what the largest differences of what a channel is made of change in it, one added to the other. The virial
    of the attraction goes with the root of the indentation, the energy stored with the power 5/2 of it.

    `largest`: largest differences of those, as `phasemap.validation.checking.tolerance.allowed` has them.
    """
    scope, values = picture.claims.microscope, again.values
    orbit = {name: values[name] for name in ("dissipation", "virial", *OF_ADHESION)}
    with np.errstate(all="ignore"):
        deeper = largest["indentation"] / np.abs(values["indentation"])
    apart = {name: largest[name] for name in ("dissipation", "virial")}
    power = {name: 2.5 if name == "contact_storage" else 0.5 for name in OF_ADHESION}
    apart |= {name: np.abs(orbit[name]) * power[name] * deeper for name in OF_ADHESION}
    offset = np.abs(picture.raw("phase") - picture["phase"]).reshape(-1)[again.pixels] if "phase" in picture else 0.0
    turned = largest["phase"] + offset

    def value(channel: Channel, turn: Array | float = 0.0, **moved: Array) -> Array:
        known = {name: one for name, one in {**orbit, **moved}.items() if name in (*channel.needs, channel.of_orbit)}
        return channel.value(motion_of(scope, values["amplitude"], values["phase"] + turn, known))

    found = {}
    for channel in derived_in(picture):
        if channel.bimodal:
            continue
        change = np.abs(value(channel, turned) - value(channel, -turned))
        for name in {*channel.needs, channel.of_orbit} & set(orbit):
            ends = (value(channel, **{name: orbit[name] + sign * apart[name]}) for sign in (1, -1))
            change = change + np.abs(np.subtract(*ends))
        again_here = value(channel)
        claimed = picture[channel.name].reshape(-1)[again.pixels]
        found[channel.name] = claimed, again_here, change + ROUNDING * np.abs(again_here)
    return found
