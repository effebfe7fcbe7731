"""What several subcommands share: options, and how a line is printed."""

from pathlib import Path
from typing import Annotated

import typer

from sim.screen import plain

SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="change a key, e.g. sensors.speed_bias_m_s=0.1")
]


def folder_option(text: str) -> Path:
    """The folder that an option names; refuses an empty name."""
    if not text.strip():
        raise typer.BadParameter("the name of the folder is empty; '.' is the current one")
    return Path(text)


OutOption = Annotated[
    Path | None,
    typer.Option(
        parser=folder_option, metavar="FOLDER", help="folder for the results (default: one of its own in out/)"
    ),
]

WorkersOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="local processes (default: one for each core)")
]
QuickOption = Annotated[bool, typer.Option("--quick", help="fewer and shorter runs")]
ForceOption = Annotated[bool, typer.Option("--force", help="compute everything again")]
ClusterOption = Annotated[str | None, typer.Option(metavar="tcp://HOST:PORT", help="compute on this Dask cluster")]


def say(text: object) -> None:
    """Print a line of text from a file or a user without control characters."""
    typer.echo(plain(text))
