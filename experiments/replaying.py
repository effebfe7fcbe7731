"""Navigation once more on a log, and what a log holds."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sim.scenario_file import override, validate


def replay(path: Path, variant: str, assignments: Iterable[str], out: Path | None) -> None:
    """Navigate on the measurements of a log and print errors beside those of the log.

    Args:
        path: log of a flight.
        variant: which LAISN.
        assignments: overrides of the scenario's navigation, `navigation.key=value`.
        out: log for the new estimates; None: none.

    Raises:
        LogError: the log cannot be read.
        ScenarioError: variant or overrides are at fault, or touch more than navigation.
    """
    from experiments.fly import position_and_bearing_errors, show, summarise
    from laisn.navigator import Navigator
    from sim import log, log_reader
    from sim.flight import navigation_settings
    from sim.scenario_file import ScenarioError
    from sim.sensors import observe

    flown = log_reader.read(path)
    given = [f"navigation.variant={variant}", *assignments]
    outside = [a for a in given if not a.startswith("navigation.")]
    if outside:
        raise ScenarioError(f"--set {outside[0]}: a replay can change navigation only; what was measured is fixed")
    table = override(flown.scenario.model_dump(mode="json", exclude_none=True), given)
    scenario = validate(table, f"{path} {' '.join(f'--set {a}' for a in given)}")
    estimates = tuple(
        Navigator(navigation_settings(scenario, flown.trajectory, i), observe(flown.trajectory, scenario, i).start).run(
            measured
        )
        for i, measured in enumerate(flown.measurements)
    )
    again = replace(flown, scenario=scenario, estimates=estimates)
    console = Console()
    for title, flight in ((f"as flown, {flown.scenario.navigation.variant}", flown), (f"replayed, {variant}", again)):
        console.print(f"[bold]{title}[/]")
        show(console, flight, summarise(flight, position_and_bearing_errors(flight)))
    if out is not None:
        import json

        errors = position_and_bearing_errors(again)
        log.write(again, out, summary=json.dumps(summarise(again, errors), indent=2) + "\n", errors=errors)
        console.print(f"log in {out}")


def show_info(path: Path) -> None:
    """Print what a log holds; LogError if it cannot be read."""
    from sim.log_info import info

    found = info(path)
    console = Console()
    console.print(f"{path}: {found.size / 1e6:.2f} MB, {found.duration_s:g} s from {found.start.isoformat()}")
    table = Table("channel", "schema", "messages", box=None, pad_edge=False)
    for channel in found.channels:
        table.add_row(channel.topic, channel.schema, str(channel.messages))
    console.print(table)
    for name, size in found.attachments.items():
        console.print(f"attachment {name}: {size} bytes")
    for name, record in found.metadata.items():
        console.print(f"metadata {name}: {', '.join(f'{k}={v}' for k, v in record.items())}", soft_wrap=True)
