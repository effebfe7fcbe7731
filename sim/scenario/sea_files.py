"""What a user may set of a sea that is read from files, or is a class of the user's own."""

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from sim.scenario.class_keys import ClassValue
from sim.scenario.section import CUSTOM_CLASS, Section
from sim.system import file_digest

_SHA256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
CastNumber = Annotated[int, Field(ge=1, le=10_000_000)] | None
CAST_NUMBER: Any = Field(
    None, description="number of the cast in a file of several; default: the nearest to the origin"
)


class MapOrigin(Section):
    """Where (0, 0) and time 0 of the scenario are on the map; `lat` and `lon` are accepted, too."""

    latitude_deg: Annotated[float, Field(ge=-89, le=89)] | None = Field(
        None, description="default: origin_latitude_deg"
    )
    longitude_deg: Annotated[float, Field(ge=-180, le=360)] | None = Field(
        None, description="default: origin_longitude_deg"
    )
    time: str | None = Field(None, description="ISO 8601, with zone; default: epoch")

    @model_validator(mode="before")
    @classmethod
    def _short_keys(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        full = {"lat": "latitude_deg", "lon": "longitude_deg"}
        return {full.get(key, key): value for key, value in data.items()}

    @field_validator("longitude_deg")
    @classmethod
    def _west_is_negative(cls, longitude: float | None) -> float | None:
        return longitude - 360.0 if longitude is not None and longitude > 180.0 else longitude

    @field_validator("time")
    @classmethod
    def _time_has_a_zone(cls, text: str | None) -> str | None:
        if text is not None and datetime.fromisoformat(text).tzinfo is None:
            raise ValueError(
                f"{text!r} is no ISO 8601 time with zone, such as 2026-01-01T00:00:00+00:00"
            )
        return text


class SeaFile(Section):
    """A file with a field of the sea."""

    file: str | None = Field(None, description="NetCDF file, path relative to this file")
    sha256: _SHA256 | None = Field(
        None,
        description="of the file's content, filled in when a scenario is read; a file with other "
        "content is refused",
    )

    @field_validator("file")
    @classmethod
    def _absolute(cls, file: str | None) -> str | None:
        """From here on absolute; the reader of scenario files has put the file's folder before
        it.
        """
        return None if file is None else str(Path(file).absolute())

    @model_validator(mode="after")
    def _with_digest(self) -> Self:
        """With the digest of the file, so that results are those of its content."""
        if self.file is not None and self.sha256 is None:
            # the model is frozen
            self.__dict__["sha256"] = file_digest(Path(self.file))
        return self


class CustomKeys(Section):
    """Fields of the user's class, with or without unit."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, ClassValue]


class CurrentSource(SeaFile):
    """A current from a file, or from the user's class, in place of the keys `current_…`."""

    file: str | None = Field(
        None,
        description="NetCDF file with eastward and northward velocity, path relative to this file",
    )
    model: Annotated[str, Field(pattern=CUSTOM_CLASS)] | None = Field(
        None, description="the user's class, module:Class"
    )
    custom: CustomKeys = CustomKeys()

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.model is None):
            raise ValueError("a current needs `file` or `model`, and not both")
        return self


class FloorSource(SeaFile):
    """A floor from a file, in place of `floor_depth_m`."""

    file: str = Field(
        description="NetCDF file with elevations or depths, path relative to this file"
    )


class SoundSource(SeaFile):
    """A speed of sound by depth from a file, in place of `acoustics.sound_speed_profile`."""

    file: str = Field(
        description="cast, CSV or NetCDF, of temperature, salinity and pressure or depth, or of "
        "the speed; path relative to this file"
    )
    profile: CastNumber = CAST_NUMBER


class DensitySource(SeaFile):
    """A density by depth from a file, which buoyancy follows, in place of `density_kg_m3`."""

    file: str = Field(
        description="cast, CSV or NetCDF, of temperature, salinity and pressure or depth, or of "
        "the density; path relative to this file"
    )
    profile: CastNumber = CAST_NUMBER
    trim_depth_m: Annotated[float, Field(ge=0, le=11000)] | None = Field(
        None,
        description="depth at which hulls have the buoyancy that their files or trim say; "
        "default: where each starts",
    )
