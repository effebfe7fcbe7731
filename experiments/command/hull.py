"""`laisn hull`: a first MJCF of a user's own vehicle, from dimensions or from an SDF file of Gazebo."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from laisn.failure import LaisnError, plain

LARGEST_SDF = 10_000_000
"""Size of an SDF file [bytes]."""


def hull(
    length: Annotated[float | None, typer.Option(help="length of the hull [m]")] = None,
    diameter: Annotated[float | None, typer.Option(help="diameter of the hull [m]")] = None,
    mass: Annotated[float | None, typer.Option(help="mass with all that floods [kg]; the hull is neutral")] = None,
    fins: Annotated[str, typer.Option(help="'+': rudders and stern planes, 'x': four fins at 45°")] = "+",
    propeller: Annotated[
        float | None, typer.Option(help="diameter of the propeller [m]; default: 0.7 of the hull")
    ] = None,
    sdf: Annotated[
        Path | None, typer.Option(help="read gz-sim's Hydrodynamics, Thruster and LiftDrag from this SDF file instead")
    ] = None,
) -> None:
    """Print a first MJCF of an own vehicle, with the formula or source of each number."""
    from sim.system import read_text
    from sim.vehicle.estimate import from_dimensions
    from sim.vehicle.own_hull import hull_errors
    from sim.vehicle.sdf_import import from_sdf

    if sdf is not None:
        if any(value is not None for value in (length, diameter, mass, propeller)):
            raise LaisnError("--sdf: the file has the dimensions; leave --length, --diameter, --mass, --propeller out")
        try:
            file, remarks = from_sdf(read_text(sdf, LARGEST_SDF))
        except LaisnError as error:
            raise LaisnError(f"{sdf}: {error}") from None
        text, errors = file.xml(), hull_errors(file.xml(), "leader")
        for remark in remarks:
            typer.echo(plain(f"note: {remark}"), err=True)
        if errors:
            raise LaisnError("\n".join([f"{sdf}: the hull cannot be simulated:", *(f"  {error}" for error in errors)]))
    else:
        if length is None or diameter is None or mass is None:
            raise LaisnError("give --length, --diameter and --mass, or --sdf FILE")
        text = from_dimensions(length, diameter, mass, fins, propeller).xml()  # type: ignore[arg-type]  # it names them
    sys.stdout.write(text)
