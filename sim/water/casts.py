"""Speeds of sound and densities by depth out of casts: tables and NetCDF files of temperature and
salinity, or of the speed or the density itself.

Temperature, salinity and pressure become speeds and densities by TEOS-10 (IOC, SCOR and IAPSO, The
international thermodynamic equation of seawater 2010; package gsw).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.system import file_digest
from sim.water.cast_files import CastValues, read_cast_values
from sim.water.field_files import FieldOrigin, Source


class _Profiled(NamedTuple):
    """A quantity that a cast gives by depth."""

    key: str  # of `CAST_QUANTITIES`, where a file has the quantity itself
    title: str  # in a sentence
    plural: str
    unit: str
    # bounds in the sea, which keys of a scenario for the quantity have too
    smallest: float
    largest: float
    digits: int  # in a report


_SPEED = _Profiled("speed", "speed of sound", "speeds of sound", "m/s", 1300.0, 1700.0, 1)
_DENSITY = _Profiled("density", "density", "densities", "kg/m³", 950.0, 1100.0, 2)


@dataclass(frozen=True, kw_only=True)
class Cast:
    """A speed of sound, or a density, by depth."""

    points: Floats  # depth [m] and speed [m/s] or density [kg/m³], shape (n, 2), depths increasing
    report: str  # what was read, in a line


def read_cast(source: Source, origin: FieldOrigin, profile: int | None = None) -> Cast:
    """The speed of sound of a file; FieldError if it has none.

    `profile` is the number of the cast in a file of several; None: the nearest to the origin.
    """
    return _read_profile(source, file_digest(source.file), origin, profile, _SPEED)


def read_density(source: Source, origin: FieldOrigin, profile: int | None = None) -> Cast:
    """The density of a file, likewise."""
    return _read_profile(source, file_digest(source.file), origin, profile, _DENSITY)


# the digest is only a key of the cache: a changed file is read again
@lru_cache(maxsize=8)
def _read_profile(
    source: Source,
    _digest: str | None,
    origin: FieldOrigin,
    profile: int | None,
    quantity: _Profiled,
) -> Cast:
    cast_values = read_cast_values(source, origin, profile)
    depth, value = _by_depth(source, cast_values, origin, quantity)
    present = np.isfinite(depth) & np.isfinite(value)
    rows = present.size
    if not present.any():
        raise source.error("none of its rows has all numbers that are needed")
    order = np.argsort(depth[present], kind="stable")
    depth = depth[present][order]
    value = value[present][order]
    if depth[0] < 0.0:
        raise source.error(f"it has a depth of {depth[0]:g} m; depths count downwards")
    # first row of each depth
    distinct = np.flatnonzero(np.diff(depth, prepend=-1.0) > 1e-6)
    # rows of one depth are averaged
    means = np.add.reduceat(value, distinct) / np.diff([*distinct, depth.size])
    points = np.column_stack([depth[distinct], means])
    lowest = points[:, 1].min()
    highest = points[:, 1].max()
    if lowest < quantity.smallest or highest > quantity.largest:
        raise source.error(
            f"its {quantity.plural} are {lowest:.4g} to {highest:.4g} {quantity.unit}; expected "
            f"{quantity.smallest:g} to {quantity.largest:g} {quantity.unit}: are units of "
            "temperature, salinity and depth right?"
        )
    report = (
        f"{source.file.name}: {', '.join(cast_values.names)}; {len(points)} depths, "
        f"{points[0, 0]:.4g} to {points[-1, 0]:.4g} m, {lowest:.{quantity.digits}f} to "
        f"{highest:.{quantity.digits}f} {quantity.unit}"
    )
    if cast_values.place:
        report += f"; {cast_values.place}"
    report = "; ".join([report, *cast_values.remarks])
    if not present.all():
        report += f"; {rows - int(present.sum())} of {rows} rows lack numbers and are left out"
    return Cast(points=points, report=report)


def _by_depth(
    source: Source, cast_values: CastValues, origin: FieldOrigin, quantity: _Profiled
) -> tuple[Floats, Floats]:
    """Depths [m] of the rows of a cast, and a quantity there."""
    values = cast_values.values
    latitude = origin.latitude_deg
    if "depth" not in values and "pressure" not in values:
        raise source.error("it has neither depth nor pressure; expected a column 'depth'")
    try:
        import gsw
    except ImportError:
        raise source.error(
            "reading casts needs packages that are not installed: pip install 'laisn-sim[fields]'"
        ) from None
    depth = values.get("depth")
    pressure = values.get("pressure")
    if depth is None:
        depth = -gsw.z_from_p(pressure, latitude)
    if pressure is None:
        pressure = gsw.p_from_z(-depth, latitude)
    if quantity.key in values:
        return np.asarray(depth), values[quantity.key]
    salinity, temperature = _salinity_and_temperature(
        source, cast_values, pressure, origin, quantity
    )
    by_teos: Callable[..., Any] = gsw.sound_speed if quantity is _SPEED else gsw.rho
    return np.asarray(depth), np.asarray(by_teos(salinity, temperature, pressure))


def _salinity_and_temperature(
    source: Source,
    cast_values: CastValues,
    pressure: Floats,
    origin: FieldOrigin,
    quantity: _Profiled,
) -> tuple[Floats, Floats]:
    """Absolute salinity [g/kg] and conservative temperature [°C] of the rows of a cast."""
    import gsw

    remarks = "".join(f"; {remark}" for remark in cast_values.remarks)
    values = cast_values.values
    salinity = values.get("absolute")
    if salinity is None:
        practical = values.get("salinity")
        if practical is None:
            raise source.error(
                f"it has no salinity, and no {quantity.title}; expected 'salinity'{remarks}"
            )
        longitude_latitude = (origin.longitude_deg, origin.latitude_deg)
        salinity = gsw.SA_from_SP(practical, pressure, *longitude_latitude)
    if "conservative" in values:
        temperature = values["conservative"]
    elif "temperature" in values:
        temperature = gsw.CT_from_t(salinity, values["temperature"], pressure)
    elif "potential" in values:
        temperature = gsw.CT_from_pt(salinity, values["potential"])
    else:
        raise source.error(
            f"it has no temperature, and no {quantity.title}; expected 'temperature'{remarks}"
        )
    return np.asarray(salinity), np.asarray(temperature)
