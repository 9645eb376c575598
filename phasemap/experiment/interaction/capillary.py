"""A film of liquid on tip and sample, and the neck that it draws between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from phasemap._kernels.columns import BRIDGE, BRIDGE_CURVE, BRIDGE_FALL, CONTACT, INVERSE_REACH, PULL
from phasemap._shared.arrays import Array
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import Necks, SphereLaw

MODELS = ("constant volume", "constant force", "linear")
# Of water at 25 C that adsorbs on a solid: Hamaker constant of solid, film and vapour [J], number density [1/m3], k T
# [J] (Israelachvili, Intermolecular and Surface Forces, 3rd ed., 2011, section 13.9).
FILM_HAMAKER, NUMBER_DENSITY, THERMAL = 1e-20, 3.33e28, 4.116e-21
HUMIDITY = 0.5  # of a room
FILM, VOLUME = (0.05e-9, 20e-9), (1e-30, 1e-20)  # what is found in practice [m, m3]


def adsorbed_film(humidity: float) -> float:
    """Thickness [m] of the film of water that a solid adsorbs at a relative humidity: theory, Eq. (model-25).

    h^3 = H / (6 pi n kT ln(1/humidity)), from the balance of the film's van der Waals pressure with its vapour's.
    """
    return math.cbrt(FILM_HAMAKER / (6 * math.pi * NUMBER_DENSITY * THERMAL * -math.log(humidity)))


@dataclass(frozen=True)
class Capillary(SphereLaw):
    """DMT contact under films of liquid, which draw a neck between tip and sample: theory, Eqs. (model-21) to (-25).

    A neck forms on the way in where the films meet, at gap D = reach (h_tip + h_sample), and breaks on the way out at
    V^(1/3) - V^(2/3)/(5 R). In between it attracts with 4 pi R gamma cos(theta) [1 - D / sqrt(V/(pi R) + D^2)] where
    its volume V is constant (Rabinovich, Esayanur and Moudgil, Langmuir 21, 10992 (2005)), and with the first factor in
    contact. V is the overlap of both films in contact, pi H^2 (R + h_tip - H/3) with H = h_tip + h_sample (Zitzler,
    Herminghaus and Mugele, Phys. Rev. B 66, 155436 (2002), for films of one thickness). Motion over it is marched in
    time.

    Parameters
    ----------
    film_thickness : float, optional
        h of the sample's film [m], >= 0; a material with a ``liquid_film`` of its own has that. By default that of
        the humidity.
    humidity : float, optional
        Relative humidity, 0 to 1 without both ends, which sets the thickness of films that are not given:
        `adsorbed_film`. By default 0.5, unless there is a `film_thickness`.
    volume : float, optional
        V [m3], > 0, in place of that of the films.
    tip_film : float, optional
        h of the film on the tip [m], >= 0; by default that of `film_thickness` or the humidity.
    surface_tension : float
        gamma [N/m], > 0; by default that of water.
    contact_angle : float
        Of the liquid on the sample [degree]; a material with one of its own has that. The mean cosine of both angles
        counts; no neck forms where that is 0 or below.
    tip_angle : float
        The same on the tip [degree].
    reach : float
        Gap at which the neck forms, over H: 1 where films meet at rest, 1.5 where attraction makes them bulge.
    wet_attraction : float
        Share of the attraction between the solids that is left in liquid, 0 to 1.
    model : {"constant volume", "constant force", "linear"}
        How the force depends on the gap: as above; not at all; or falling as a line to 0 where the neck breaks.
    """

    film_thickness: Number[float | None] = Number("m", None, minimum=0, usual=FILM)
    humidity: Number[float | None] = Number("1", None, above=0, below=1)
    volume: Number[float | None] = Number("m3", None, above=0, usual=VOLUME)
    tip_film: Number[float | None] = Number("m", None, minimum=0, usual=FILM)
    surface_tension: Number[float] = Number("N/m", 0.072, above=0, usual=(1e-3, 1.0))
    contact_angle: Number[float] = Number("degree", 0.0, minimum=0, maximum=180)
    tip_angle: Number[float] = Number("degree", 0.0, minimum=0, maximum=180)
    reach: Number[float] = Number("1", 1.0, above=0, maximum=10)
    wet_attraction: Number[float] = Number("1", 1.0, minimum=0, maximum=1)
    model: str = "constant volume"
    name: ClassVar[str] = "capillary"
    wets: ClassVar[bool] = True
    in_time: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_choice("model of the neck", self.model, MODELS)
        if self.film_thickness is not None and self.humidity is not None:
            raise InputError("humidity", self.humidity, "None where film_thickness is given")

    @staticmethod
    def force(d: float, p: Array) -> float:
        """Force of the neck, beside Hertz and adhesion in contact, and van der Waals out of it."""
        gap = max(-d, 0.0)
        x = gap * p[BRIDGE_CURVE]
        bridge = p[BRIDGE] * (1.0 - x / math.sqrt(1.0 + x * x) - gap * p[BRIDGE_FALL])
        if d >= 0.0:
            return p[CONTACT] * d * math.sqrt(d) - p[PULL] - bridge
        if p[INVERSE_REACH] == 0.0:
            return -bridge
        s = 1.0 + gap * p[INVERSE_REACH]
        return -p[PULL] / (s * s) - bridge

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Of the same terms; the neck's force is constant in contact."""
        if d >= 0.0:
            return 1.5 * p[CONTACT] * math.sqrt(d)
        gap = -d
        x, s = gap * p[BRIDGE_CURVE], 1.0 + gap * p[INVERSE_REACH]
        of_bridge = p[BRIDGE] * (p[BRIDGE_CURVE] / (1.0 + x * x) ** 1.5 + p[BRIDGE_FALL])
        return -2.0 * p[PULL] * p[INVERSE_REACH] / (s * s * s) - of_bridge

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array, ...]:
        """p[CONTACT] = K sqrt(R) [N m^-1.5], p[PULL] = attraction that is left under liquid [N]."""
        pull = self.pull(contact_stiffness, adhesion, radius)
        return contact_stiffness * math.sqrt(radius), self.wet_attraction * pull

    def necks(self, radius: float, liquid: Array) -> Necks:
        """The necks of a tip of this radius [m] on films of this thickness [m] and contact angle [degree]."""
        film, angle = liquid.T
        on_sample = self.film_thickness
        if on_sample is None:
            on_sample = adsorbed_film(HUMIDITY if self.humidity is None else self.humidity)
        on_tip = on_sample if self.tip_film is None else self.tip_film
        both = np.where(np.isfinite(film), film, on_sample) + on_tip
        angle = np.where(np.isfinite(angle), angle, self.contact_angle)
        wetting = 0.5 * (np.cos(np.radians(angle)) + math.cos(math.radians(self.tip_angle)))
        cap = np.minimum(both, 2 * (radius + on_tip))  # the tip with its film as a whole, where that is under liquid
        volume = np.pi * cap**2 * (radius + on_tip - cap / 3) if self.volume is None else self.volume + 0.0 * both
        forms = (both > 0) & (wetting > 0)
        volume, both = np.where(forms, volume, 0.0), np.where(forms, both, 0.0)
        release = -(np.cbrt(volume) - np.cbrt(volume) ** 2 / (5 * radius))
        curve = np.where(forms, 1 / np.sqrt(np.where(forms, volume, 1.0) / (np.pi * radius)), 0.0)
        fall = np.where(forms, -1 / np.where(forms, release, -1.0), 0.0)
        force = np.where(forms, 4 * np.pi * radius * self.surface_tension * wetting, 0.0)
        return Necks(
            release + 0.0, 0.0 - self.reach * both, force,
            curve if self.model == "constant volume" else 0.0 * curve, fall if self.model == "linear" else 0.0 * fall,
        )  # fmt: skip
