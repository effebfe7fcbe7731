"""Import of data sets, tables and bags as logs, and proposals of maps for them."""

from pathlib import Path

from rich.console import Console

from experiments.campaign.progress import print_line
from laisn.errors import LaisnError
from laisn_sim.cli.outputs import output_file
from sim.datasets.bag import is_bag
from sim.datasets.bag_table import read_bag_table
from sim.datasets.field_map import FieldMap, Proposal, map_of, read_map, write_proposal
from sim.datasets.log import VEHICLE, read_data_set, write_data_set, write_vehicle_table
from sim.datasets.map_proposal import propose_for_bag, propose_for_table
from sim.datasets.vehicle_table import VehicleTable, read_vehicle_table

_TABLES = (".csv", ".tsv")


def _is_table(source: Path) -> bool:
    # NAME_DR.csv is the odometry of a data set of ranging radios
    return source.suffix in _TABLES and not source.stem.endswith("_DR")


def _proposal(source: Path, vehicle: str | None) -> Proposal:
    if is_bag(source):
        return propose_for_bag(source, vehicle)
    if not _is_table(source):
        raise LaisnError(
            f"{source}: expected a table ({' or '.join(_TABLES)}) or a bag of ROS; other data sets "
            "need no map"
        )
    if vehicle is not None:
        raise LaisnError(f"--vehicle {vehicle}: {source} is a table, and has no topics")
    return propose_for_table(source)


def propose_map(source: Path, map_path: Path, vehicle: str | None) -> None:
    """Write the map that is proposed for a table or a bag, and print what is in doubt."""
    # refused before the source is read if it cannot be written
    output = output_file(map_path, [".toml"], [source], "--propose")
    proposal = _proposal(source, vehicle)
    write_proposal(proposal, map_path)
    console = Console()
    for field, entry in proposal.entries.items():
        source_text = entry.get("column") or f"{entry['topic']} {entry['field']}"
        unit = f" in {entry['unit']}" if "unit" in entry else ""
        note = f"; check: {proposal.notes[field]}" if field in proposal.notes else ""
        print_line(console, f"{source_text}{unit}{note}", f"{field}:", "")
    if proposal.missing:
        print_line(console, f"nothing was found for {', '.join(proposal.missing)}", "note:")
    print_line(
        console, f"map in {output}; edit it, then: laisn log import {source} --map {map_path}"
    )


def _proposed_map(source: Path, vehicle: str | None) -> FieldMap:
    """The map that is proposed for a bag, if nothing of it is in doubt."""
    proposal = propose_for_bag(source, vehicle)
    doubts = [
        *(f"  {field}: nothing was found for it" for field in proposal.missing),
        *(f"  {field}: {note}" for field, note in proposal.notes.items()),
    ]
    if doubts:
        command = f"laisn log import {source} --propose map.toml"
        raise LaisnError(
            "\n".join(
                [
                    f"{source}: needs --map, or --vehicle NAME if the bag has several vehicles; a "
                    f"proposal to edit: {command}",
                    *doubts,
                ]
            )
        )
    return map_of(proposal.table(), source)


def _measurements(source: Path, map_path: Path | None, vehicle: str | None) -> VehicleTable:
    if vehicle is not None and (map_path is not None or not is_bag(source)):
        raise LaisnError(f"--vehicle {vehicle}: expected with a bag that is imported without --map")
    if map_path is not None and not map_path.exists():
        raise LaisnError(
            f"--map {map_path}: no such file; a proposal: laisn log import {source} --propose "
            f"{map_path}"
        )
    if not is_bag(source):
        return read_vehicle_table(source, None if map_path is None else read_map(map_path))
    field_map = _proposed_map(source, vehicle) if map_path is None else read_map(map_path)
    return read_bag_table(source, field_map)


def import_recording(
    source: Path, out: Path, map_path: Path | None, vehicle: str | None, beacons: str | None
) -> None:
    """Write a data set, or a vehicle's measurements in a table or a bag, as a log."""
    output = output_file(out, [".mcap"], [source])
    console = Console()
    if is_bag(source) or _is_table(source):
        if beacons is not None:
            raise LaisnError(
                f"--beacons {beacons}: {source} is of a vehicle, whose ranges have no beacons"
            )
        table = _measurements(source, map_path, vehicle)
        write_vehicle_table(table, out)
        for remark in table.remarks:
            print_line(console, remark)
        print_line(
            console, f"log in {output}; to navigate on it: laisn replay {out} --scenario FILE"
        )
        return
    if map_path is not None or vehicle is not None:
        raise LaisnError(f"--map, --vehicle: expected with a table or a bag (given: {source})")
    data = read_data_set(source)
    if beacons is not None:
        data = data.with_beacons([name.strip() for name in beacons.split(",") if name.strip()])
    # as written: without robots that do not fit
    data = write_data_set(data, out)
    print_line(
        console,
        f"{VEHICLE}: {len(data.odometry)} steps of odometry in "
        f"{data.time[-1] - data.time[0]:.1f} s",
    )
    for i, (name, (east, north)) in enumerate(zip(data.beacons, data.places[:, :2], strict=True)):
        # each range has the number of its beacon
        ranges = (data.range_beacon == i).sum()
        print_line(
            console, f"beacon {name} at {east:.2f} m east, {north:.2f} m north: {ranges} ranges"
        )
    print_line(console, f"reference path: {len(data.truth)} positions")
    for remark in data.remarks:
        print_line(console, remark, "note:")
    print_line(console, f"log in {output}")
