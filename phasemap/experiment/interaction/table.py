"""A force given by numbers, in contact and outside."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from phasemap._kernels.columns import BIAS, DAMPING, EXPONENT
from phasemap._shared.arrays import Array
from phasemap._shared.errors import FileError, InputError, Word
from phasemap._shared.quantities import NotThatUnit, scaled
from phasemap.experiment.interaction.base import ContactLaw
from phasemap.experiment.interaction.longrange import LongRange

if TYPE_CHECKING:
    import os

    from phasemap.experiment.material import Material
    from phasemap.experiment.microscope import Microscope

    Formula = Callable[[float, Array], float]

RADIUS, RADIUS_AT_RADIUS = 2, 3  # columns: R [m], damping at d = R [N s/m]
FEWEST = 4  # points of a table
OUTER, INNER, LEAST = 100e-9, 20e-9, 1e-13  # depths [m] at which `from_law` asks for a law, and the least apart from 0
COLUMNS = {"depth": "m", "gap": "m", "force": "N", "damping": "N s/m", "withdrawal": "N"}


@dataclass(frozen=True)
class Table(ContactLaw):
    """Force, and damping if wanted, at given depths: of another program, of molecular dynamics, of a measurement.

    Between the points are monotone cubics (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 238 (1980); Fritsch and
    Butland, SIAM J. Sci. Stat. Comput. 5, 300 (1984)), apart in contact and outside, so that there may be a kink at
    d = 0. Deeper than the last point the force goes on as a line; beyond the first it falls to 0 over as far again.
    Modulus and adhesion of materials do not act, nor does a decay length.

    Parameters
    ----------
    depths : sequence of float
        d [m], rising; below 0 outside contact. 0 may be there twice, where the force jumps.
    forces : sequence of float
        F [N], positive repulsive.
    dampings : sequence of float, optional
        Damping in contact [N s/m] of a material with a viscosity of 1 Pa s; one of another viscosity has so many times
        that. By default that of a sphere.

    Examples
    --------
    >>> law = Table((-2e-9, -1e-9, 0.0, 1e-9, 2e-9), (0.0, -1e-9, -4e-9, 10e-9, 30e-9))
    >>> round(law.force(1e-9, None) * 1e9, 6), round(law.attraction.force(-1e-9, None) * 1e9, 6)
    (10.0, -1.0)
    """

    depths: tuple[float, ...]
    forces: tuple[float, ...]
    dampings: tuple[float, ...] | None = None
    withdrawal_forces: tuple[float, ...] | None = None
    name: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        for field in ("depths", "forces", "dampings", "withdrawal_forces"):
            if (values := getattr(self, field)) is not None:
                object.__setattr__(self, field, tuple(np.asarray(values, dtype=np.float64).ravel().tolist()))
        d = np.array(self.depths)
        twice = (d[1:] == 0.0) & (d[:-1] == 0.0) & (np.arange(len(d) - 1) == np.sum(d < 0.0))
        rises = ((np.diff(d) > 0.0) | twice).all()
        if len(d) < FEWEST or not (np.isfinite(d).all() and rises and d[0] <= 0.0 < d[-1]):
            numbers = f"{len(d)} numbers from {d[0]:g} to {d[-1]:g}" if len(d) else "empty"
            raise InputError("depths", numbers, f"{FEWEST} or more that rise, from 0 m or below to above")
        for field in ("forces", "dampings", "withdrawal_forces"):
            values = getattr(self, field)
            if values is not None and not (len(values) == len(d) and np.isfinite(values).all()):
                raise InputError(field, Word(f"{len(values)} numbers"), f"{len(d)} finite ones, for as many depths")
        if self.dampings is not None and min(self.dampings) < 0:
            raise InputError("dampings", min(self.dampings), "numbers of at least 0 N s/m")
        if self.withdrawal_forces is not None and min(inner := self._pulled) < 0:
            at = self.depths[-len(inner) :][inner.index(min(inner))]
            hint = "A loop of contact would create energy."
            raise InputError("withdrawal_forces", Word(f"above forces at {at:g} m"), "forces at most, in contact", hint)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Table:
        """Read a table from .npz, or from columns of text under a line of their names and units.

        Columns are called depth (or gap, its opposite), force, damping and withdrawal: ``gap [nm], force [nN]``.
        Arrays of .npz have these names too, and SI units.
        """
        path = Path(path)
        try:
            if path.suffix == ".npz":
                with np.load(path, allow_pickle=False) as file:
                    columns = {name: np.asarray(file[name], dtype=np.float64) for name in file.files if name in COLUMNS}
            else:
                columns = _columns_of(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise FileError(f"cannot read {path}: {error}") from error
        if "gap" in columns:
            columns["depth"] = -columns.pop("gap")
        if not {"depth", "force"} <= set(columns):
            raise FileError(f"cannot use {path}: it lacks columns depth (or gap) and force, as 'gap [nm], force [nN]'.")
        order = np.argsort(columns["depth"])
        named = {"depth": "depths", "force": "forces", "damping": "dampings", "withdrawal": "withdrawal_forces"}
        return cls(**{named[name]: tuple(values[order]) for name, values in columns.items()})

    @classmethod
    def from_law(cls, material: Material, scope: Microscope, depths: Any = None) -> Table:
        """The forces of another law, of a material under the tip of a microscope.

        Raises InputError if a table does not know all that the law does: necks, films, losses of its own, and
        materials that relax.

        `depths` : sequence of float, optional
            Where it is asked [m]; by default densest at d = 0, from -100 to 20 nm.
        """
        from phasemap.experiment.material import relaxes
        from phasemap.experiment.material_rows import properties, rows_of

        law = scope.interaction.law
        if law.hysteretic or law.lossy or type(law).damping is not ContactLaw.damping:
            raise InputError("contact", law.name, "a law without a neck, films or losses of its own")
        if relaxes(material):
            raise InputError("material", material, "one that does not relax, for a table has no memory")

        if depths is None:
            inner, outer = np.geomspace(LEAST, INNER, 300), np.geomspace(LEAST, OUTER, 300)
            depths = np.concatenate([-outer[::-1], [0.0], inner])
        row, viscous = rows_of([material])
        acts = scope.interaction
        p = acts.columns(*properties(row, viscous, scope), scope.tip.radius)[0]
        d = np.asarray(depths, dtype=np.float64)
        outer, inner = np.append(d[d < 0], 0.0), np.append(0.0, d[d > 0])
        forces = [acts.outside.force(x, p) for x in outer] + [acts.law.force(x, p) - p[BIAS] for x in inner]
        contact = np.append(np.zeros(len(outer)), law.radius_at(inner, scope.tip.radius))
        return cls(tuple(np.append(outer, inner)), tuple(forces), None if law.spread == 0.5 else tuple(contact))

    @property
    def _pulled(self) -> tuple[float, ...]:
        """Differences of the forces in contact on the way in and on the way out [N]."""
        pairs = zip(self.depths, self.forces, self.withdrawal_forces or self.forces, strict=True)
        return tuple(inward - outward for d, inward, outward in pairs if d >= 0.0)

    @property
    def lossy(self) -> bool:  # type: ignore[override]
        """True if the force is another one on the way out."""
        return self.withdrawal_forces is not None

    @property
    def in_time(self) -> bool:  # type: ignore[override]
        """True if motion under this law is marched in time."""
        return self.lossy

    @property
    def withdrawn(self) -> Formula | None:
        """Attraction [N] on the way out of contact beside that on the way in."""
        if self.withdrawal_forces is None:
            return None
        return _at_least_zero(_between(self.depths[-len(self._pulled) :], self._pulled, True)[0])

    def _within(self, values: tuple[float, ...], inside: bool) -> tuple[Formula, Formula]:
        """Value and slope between the points in contact, or outside."""
        return _between(self.depths, values, inside)

    @property
    def force(self) -> Formula:  # type: ignore[override]
        """F [N] at a depth in contact."""
        return self._within(self.forces, True)[0]

    @property
    def slope(self) -> Formula:  # type: ignore[override]
        """Derivative of the force by the depth [N/m]."""
        return self._within(self.forces, True)[1]

    @property
    def damping(self) -> Formula:  # type: ignore[override]
        """alpha_s [1] at a depth in contact."""
        return super().damping if self.dampings is None else _damping(self._within(self.dampings, True)[0])

    @property
    def damping_slope(self) -> Formula:  # type: ignore[override]
        """Derivative of the damping by the depth [1/m]."""
        return super().damping_slope if self.dampings is None else _damping(self._within(self.dampings, True)[1])

    @property
    def attraction(self) -> LongRange:  # type: ignore[override]
        """The force outside contact."""
        return _outside(self)

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[1] = the attraction at d = 0 [N], p[RADIUS] = R [m], p[RADIUS_AT_RADIUS] = the damping at d = R."""
        at_radius = 1.0 if self.dampings is None else self._within(self.dampings, True)[0](radius, contact_stiffness)
        return 0.0 * contact_stiffness, self.pull(contact_stiffness, adhesion, radius), radius, at_radius

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """Attraction of the table at d = 0 [N], whatever the adhesion."""
        return 0.0 * contact_stiffness - self.force(0.0, contact_stiffness)

    def radius_at(self, depth: Array, radius: float) -> Array:
        """Radius of the contact [m] at depths: the damping over a viscosity, or that of a sphere."""
        if self.dampings is None:
            return super().radius_at(depth, radius)
        formula, unread = self._within(self.dampings, True)[0], np.zeros(0)  # a table reads no parameters
        return np.vectorize(lambda d: formula(d, unread), otypes=[float])(depth)


@lru_cache(maxsize=64)
def _outside(table: Table) -> LongRange:
    """The part of a table outside contact, as a long-range law."""
    value, rise = table._within(table.forces, False)
    d = np.linspace(table.depths[0], 0.0, 1000)
    forces, slopes = (np.array([one(x, d) for x in d]) for one in (value, rise))
    largest = float(abs(forces).max())

    class Outside(LongRange):
        name, force, slope = "table", staticmethod(value), staticmethod(rise)  # type: ignore[assignment]
        attracts = bool((forces <= 0.0).all() and (slopes <= 0.0).all())

        def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
            """p[LONGRANGE] = attraction at d = 0 [N], p[INVERSE_REACH] = steepest slope over largest force [1/m]."""
            if largest == 0.0:
                return ()
            # Beyond its first point the force is 0, as if it fell once more over the distance of that.
            steepest = max(float(abs(slopes).max()) / largest, -1.0 / table.depths[0])
            return np.where(pull == 0.0, 1e-15 * largest, pull), steepest  # 0 would say that there is no force

    return Outside()


def _columns_of(text: str) -> dict[str, Array]:
    """The columns of a text whose first line names them."""
    lines = [line for line in text.splitlines() if line.strip()]
    names = [one.strip() for one in re.split(r"[,;\t]", lines[0].lstrip("# "))] if lines else []
    table = np.loadtxt((re.sub(r"[,;\t]", " ", line) for line in lines[1:]), ndmin=2)
    columns = {}
    for name, values in zip(names, table.T, strict=False):
        part = re.fullmatch(r"(\w+)\s*[\[(](.*)[\])]", name)
        if part is not None and part[1].lower() in COLUMNS:
            try:
                columns[part[1].lower()] = scaled(values, part[2], COLUMNS[part[1].lower()])
            except NotThatUnit:
                raise ValueError(f"the column {name!r} is not in a unit of {COLUMNS[part[1].lower()]}") from None
    return columns


@lru_cache(maxsize=64)
def _between(depths: tuple[float, ...], values: tuple[float, ...], inside: bool) -> tuple[Formula, Formula]:
    """Monotone cubics through the points on one side of d = 0, and their slope, as formulas that numba compiles."""
    from scipy.interpolate import PchipInterpolator

    x, y = np.array(depths), np.array(values)
    zeros = y[x == 0.0]
    at_zero = float(zeros[-1 if inside else 0] if len(zeros) else PchipInterpolator(x, y)(0.0))
    side = x > 0.0 if inside else x < 0.0
    x, y = np.append(x[side], 0.0), np.append(y[side], at_zero)
    order = np.argsort(x)
    x, y = x[order], y[order]
    if not inside:  # falls to 0 beyond the first point
        x, y = np.append([3.0 * x[0], 2.0 * x[0]], x), np.append([0.0, 0.0], y)
        if len(x) == 3:  # nothing is given there
            x, y = np.array([-2.0, -1.0, 0.0]), np.zeros(3)
    elif len(x) < 3:
        x, y = np.append(x, 2.0 * x[-1]), np.append(y, 2.0 * y[-1] - y[0])
    c = np.ascontiguousarray(PchipInterpolator(x, y).c)
    last, low, high = len(x) - 2, float(x[0]), float(x[-1])
    rise = float(3 * c[0, -1] * (x[-1] - x[-2]) ** 2 + 2 * c[1, -1] * (x[-1] - x[-2]) + c[2, -1])
    top, end = float(y[-1]), float(y[0])
    if not inside:
        rise = 0.0

    def find(d: float) -> int:
        first, beyond = 0, last + 1
        while beyond - first > 1:
            middle = (first + beyond) // 2
            if x[middle] <= d:
                first = middle
            else:
                beyond = middle
        return first

    def value(d: float, p: Array) -> float:
        if d <= low:
            return end
        if d >= high:
            return top + rise * (d - high)
        i = find(d)
        s = d - x[i]
        return float(((c[0, i] * s + c[1, i]) * s + c[2, i]) * s + c[3, i])

    def slope(d: float, p: Array) -> float:
        if d < low:
            return 0.0
        if d > high:
            return rise
        i = find(d)
        s = d - x[i]
        return float((3.0 * c[0, i] * s + 2.0 * c[1, i]) * s + c[2, i])

    return value, slope


@lru_cache(maxsize=64)
def _at_least_zero(profile: Formula) -> Formula:
    """A table where it is positive."""

    def positive(d: float, p: Array) -> float:
        return max(profile(d, p), 0.0)

    return positive


@lru_cache(maxsize=64)
def _damping(profile: Formula) -> Formula:
    """Damping alpha_s [1], or its slope, by a table in place of the power law."""

    def damping(d: float, p: Array) -> float:
        return p[DAMPING] * p[RADIUS] ** p[EXPONENT] / p[RADIUS_AT_RADIUS] * profile(d, p)

    return damping
