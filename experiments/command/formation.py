"""`laisn formation`: the study of followers that keep stations, and its page."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.command.options import OutOption


def formation(
    quick: Annotated[bool, typer.Option("--quick", help="two runs of 100 s, a first look")] = False,
    runs: Annotated[
        int | None, typer.Option(min=1, max=10_000, help="runs of each condition, in place of the study's own number")
    ] = None,
    out: OutOption = None,
) -> None:
    """Fly ten followers in formation through currents, waves, losses and navigators."""
    from experiments.findings import FILE, read
    from experiments.formation import report, study
    from sim.screen import plain

    folder = out or Path("out") / ("formation-quick" if quick else "formation")
    study.run(folder, runs or (2 if quick else study.RUNS), 100.0 if quick else study.DURATION_S)
    page = report.write_page(read(folder / FILE), folder / "report.html", quick=quick)
    typer.echo(plain(f"report in {page}"))
