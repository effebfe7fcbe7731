"""A flight of 30 s and its log, shared by the tests of the log."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from synthetic import errors_of, make_flight

from sim.flight import Flight
from sim.log import writer
from sim.log.events import Event


def short_flight() -> Flight:
    return make_flight(30.0)


def write_log(flight: Flight, folder: Path) -> Path:
    path = folder / "mission.mcap"
    events = [Event(12.0, "warning", "mirror capture", "follower")]
    writer.write(flight, path, summary='{"runs": 1}', errors=errors_of(flight), events=events)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [item.decoded_message for item in reader.iter_decoded_messages(topics=[topic])]
