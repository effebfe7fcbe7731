"""Columns of numbers read from messages: what protobuf reads of them one by one; order, time and
memory.
"""

import struct
import time
import zlib
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader
from mcap.writer import IndexType, Writer
from mcap_protobuf.schema import register_schema

from laisn.errors import LaisnError
from sim.log.contents import Contents, LogError, Messages, recover
from sim.log.reader import read_recording
from sim.log.schema import OWN_MOTION, RECEPTION
from tests.synthetic import make_flight, messages, write_log

KIND = descriptor_pb2.FieldDescriptorProto
INTEGERS = {
    "INT32": (-(2**31), 2**31 - 1),
    "INT64": (-(2**63), 2**63 - 1),
    "UINT32": (0, 2**32 - 1),
    "UINT64": (0, 2**64 - 1),
    "SINT32": (-(2**31), 2**31 - 1),
    "SINT64": (-(2**63), 2**63 - 1),
    "FIXED32": (0, 2**32 - 1),
    "FIXED64": (0, 2**64 - 1),
    "SFIXED32": (-(2**31), 2**31 - 1),
    "SFIXED64": (-(2**63), 2**63 - 1),
}
VALUES_OF_KIND: dict[str, st.SearchStrategy[Any]] = {
    **{name: st.integers(*limits) for name, limits in INTEGERS.items()},
    "DOUBLE": st.floats(),
    "FLOAT": st.floats(width=32),
    "BOOL": st.booleans(),
    "STRING": st.text(max_size=5),
}
DEFAULTS = {"INT32": "-7", "DOUBLE": "2.5", "BOOL": "true", "STRING": "none"}


@cache
def message_class(syntax: str) -> Any:
    """A type with a field of every kind, one of its own type and a repeated one."""
    file = descriptor_pb2.FileDescriptorProto(
        name=f"all_{syntax}.proto", package=f"all_{syntax}", syntax=syntax
    )
    message = file.message_type.add(name="All")
    for number, name in enumerate(VALUES_OF_KIND, start=1):
        default = DEFAULTS.get(name) if syntax == "proto2" else None
        message.field.add(
            name=name.lower(),
            number=number,
            type=KIND.Type.Value(f"TYPE_{name}"),
            label=KIND.LABEL_OPTIONAL,
            default_value=default,
        )
    label = KIND.LABEL_OPTIONAL
    message.field.add(
        name="inner",
        number=100,
        type=KIND.TYPE_MESSAGE,
        type_name=f".all_{syntax}.All",
        label=label,
    )
    message.field.add(name="many", number=101, type=KIND.TYPE_DOUBLE, label=KIND.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"all_{syntax}.All"))


def messages_of(type_: Any, sent: list[bytes]) -> Messages:
    """Messages whose type need not be found in a schema."""
    result = Messages(None, data=sent)
    result.message_class = type_
    return result


FIELD_VALUES = st.fixed_dictionaries(
    {}, optional={name.lower(): values for name, values in VALUES_OF_KIND.items()}
)


def read_by_protobuf(message: Any, name: str) -> Any:
    """What protobuf reads of a field; None where the field has presence and is not set."""
    for part in name.split("."):
        if message.DESCRIPTOR.fields_by_name[part].has_presence and not message.HasField(part):
            return None
        message = getattr(message, part)
    return message


@pytest.mark.parametrize("syntax", ["proto2", "proto3"])
@given(
    st.lists(
        st.tuples(FIELD_VALUES, st.none() | FIELD_VALUES, st.lists(st.floats(), max_size=2)),
        max_size=4,
    ),
    st.integers(1, 3),
)
def test_every_field_is_read_as_protobuf_reads_it(
    syntax: str,
    content: list[tuple[dict[str, Any], dict[str, Any] | None, list[float]]],
    repetitions: int,
) -> None:
    type_ = message_class(syntax)
    inner_messages = [None if inner is None else type_(**inner) for _, inner, _ in content]
    sent = [
        type_(**fields, inner=inner, many=many)
        for (fields, _, many), inner in zip(content, inner_messages, strict=True)
    ]
    # a single message, repeated, has one length
    sent *= repetitions
    read = messages_of(type_, [message.SerializeToString() for message in sent])
    for prefix in ("", "inner.", "inner.inner."):
        for name in (f"{prefix}{kind.lower()}" for kind in VALUES_OF_KIND):
            (actual,) = read.columns([name])
            values = actual.tolist() if isinstance(actual, np.ndarray) else actual
            assert repr(values) == repr([read_by_protobuf(message, name) for message in sent])


NUMBERS = {
    "double": st.floats(),
    "sfixed64": st.integers(-(2**63), 2**63 - 1),
    "fixed64": st.integers(0, 2**64 - 1),
}


@given(
    st.lists(st.fixed_dictionaries({}, optional=NUMBERS), min_size=1, max_size=6),
    st.sampled_from(["", "a"]),
)
def test_messages_of_one_length_are_read_by_their_own_fields(
    field_values: list[dict[str, Any]], text: str
) -> None:
    """A double and an integer of 64 bits are equally long: only the tag distinguishes them."""
    type_ = message_class("proto3")
    sent = [type_(**values, string=text) for values in field_values]
    read = messages_of(type_, [message.SerializeToString() for message in sent])
    for name in (*NUMBERS, "string"):
        (actual,) = read.columns([name])
        assert repr(list(np.asarray(actual, dtype=object))) == repr(
            [read_by_protobuf(message, name) for message in sent]
        )


def test_numbers_of_a_flights_channels_are_what_another_decoder_reads(tmp_path: Path) -> None:
    path = write_log(make_flight(20.0), tmp_path)
    topics = Contents(path).topics
    for topic, name in (
        ("/follower/state", "position_east"),
        ("/leader/state", "pitch"),
        ("/follower/filter", "vx"),
    ):
        (actual,) = topics[topic].columns([name])
        assert isinstance(actual, np.ndarray)
        assert actual.tolist() == [
            read_by_protobuf(message, name) for message in messages(path, topic)
        ]


def test_a_field_without_a_single_value_is_refused() -> None:
    read = messages_of(message_class("proto3"), [b""])
    for name in ("inner", "many"):
        with pytest.raises(ValueError, match=f"field {name} holds no single value"):
            read.columns([name])


def test_a_message_that_is_no_protobuf_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for name, schema in (("motion", OWN_MOTION), ("reception", RECEPTION)):
            type_ = register_schema(writer, schema.message_class)
            writer.add_message(
                writer.register_channel(f"/follower/{name}", "protobuf", type_), 0, b"\x08\xff", 0
            )
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(LogError, match=r"a\.mcap: damaged, or written by something else"):
        read_recording(tmp_path / "a.mcap")


def test_messages_out_of_order_are_sorted_and_those_of_equal_time_stay_as_they_came(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(5)
    recorded = [
        (int(time_ns), rng.bytes(int(size))) for time_ns, size in rng.integers(0, 40, (200, 2))
    ]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=500)
        writer.start()
        channel = writer.register_channel("/a", "", 0)
        for time_ns, content in recorded:
            writer.add_message(channel, time_ns, content, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    actual = Contents(tmp_path / "a.mcap").topics["/a"]
    ordered = sorted(recorded, key=itemgetter(0))
    assert actual.time_ns.tolist() == [time_ns for time_ns, _ in ordered]
    assert actual.data == [content for _, content in ordered]


def test_messages_from_a_time_on_are_left_out_whatever_the_order_of_recording(
    tmp_path: Path,
) -> None:
    recorded_ns = [3, 9, 1, 5, 4, 8, 0, 5]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic in ("/data", "/times"):
            channel = writer.register_channel(topic, "", 0)
            for time_ns in recorded_ns:
                writer.add_message(channel, time_ns, bytes([time_ns]), time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    contents = Contents(tmp_path / "a.mcap", lambda topic, _: topic == "/data")
    contents.cut(5)
    assert contents.topics["/data"].time_ns.tolist() == [0, 1, 3, 4]
    assert contents.topics["/data"].data == [bytes([time_ns]) for time_ns in (0, 1, 3, 4)]
    assert contents.topics["/times"].time_ns.tolist() == [3, 1, 4, 0]


def memory_of_process(field: str) -> int:
    """Memory of this process by a field of its status in Linux [bytes]."""
    status = Path("/proc/self/status").read_text()
    return next(
        1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith(field)
    )


def log_of_many_messages(path: Path, count: int) -> Path:
    """A log of own motion every 10 ms, at the speed of 1, 2, 3 … m/s: a first message with a
    heading and an unknown field, and `count` others of one length, in chunks.
    """
    first_content = (
        OWN_MOTION.message_class(speed=1.0, heading=0.5, depth=0.0).SerializeToString()
        + b"\xf0\x01\x07"
    )
    content = OWN_MOTION.message_class(speed=1.0, heading=0.0, depth=0.0).SerializeToString()
    with path.open("wb") as stream:
        # without a summary nothing in the file gives offsets of other records
        writer = Writer(
            stream,
            enable_crcs=False,
            use_chunking=False,
            repeat_channels=False,
            repeat_schemas=False,
            use_statistics=False,
            use_summary_offsets=False,
            index_types=IndexType.NONE,
        )
        writer.start()
        for name, schema in (("motion", OWN_MOTION), ("reception", RECEPTION)):
            type_ = register_schema(writer, schema.message_class)
            data = first_content if name == "motion" else b""
            writer.add_message(
                writer.register_channel(f"/follower/{name}", "protobuf", type_), 0, data, 0
            )
        writer.finish()  # type: ignore[no-untyped-call]
    written = path.read_bytes()
    # before the records of the end of the data, 13 bytes, and of the footer, 29, and the magic, 8
    end_of_data = len(written) - 8 - 29 - 13
    # Python's writer would take as long as all other tests of logs
    record = (
        struct.pack("<BQ", Opcode.MESSAGE, 22 + len(content))
        + (1).to_bytes(2, "little")
        + bytes(20)
        + content
    )
    records = np.tile(np.frombuffer(record, dtype=np.uint8), (count, 1))
    records[:, 15:23] = (
        (10**7 * np.arange(1, count + 1, dtype="<i8")).view(np.uint8).reshape(count, 8)
    )
    records[:, 32:40] = np.arange(2.0, count + 2).view(np.uint8).reshape(count, 8)
    chunks = RecordBuilder()
    for start in range(0, count, 25_000):
        chunk_data = records[start : start + 25_000].tobytes()
        Chunk("", chunk_data, 0, 0, zlib.crc32(chunk_data), len(chunk_data)).write(chunks)
    path.write_bytes(written[:end_of_data] + chunks.end() + written[end_of_data:])
    return path


def processor_seconds(call: Any) -> float:
    """Processor time of a call [s]."""
    begun = time.process_time()
    call()
    return time.process_time() - begun


@pytest.mark.system
@pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(),
    reason="the peak of the memory can be reset on Linux",
)
def test_many_messages_of_different_lengths_take_little_time_and_memory(tmp_path: Path) -> None:
    """Less than three times the time that the library takes for reading the records alone, and less
    than 300 bytes a message.
    """
    path, count = log_of_many_messages(tmp_path / "a.mcap", 2 * 10**5), 2 * 10**5

    def read_records() -> None:
        with path.open("rb") as stream:
            assert (
                sum(
                    isinstance(r, Message) for r in StreamReader(stream, validate_crcs=True).records
                )
                == count + 2
            )

    read_recording(log_of_many_messages(tmp_path / "b.mcap", 10), "follower")
    Path("/proc/self/clear_refs").write_text("5")
    before = memory_of_process("VmRSS")
    actual = read_recording(path, "follower").measurements
    assert memory_of_process("VmHWM") - before < 300 * count
    assert actual.dt == 0.01
    np.testing.assert_array_equal(actual.speed, np.arange(1.0, count + 2))
    assert np.flatnonzero(actual.heading).tolist() == [0]
    assert processor_seconds(lambda: read_recording(path, "follower")) < 3 * processor_seconds(
        read_records
    )


@pytest.mark.system
def test_a_long_log_is_recovered(tmp_path: Path) -> None:
    path = log_of_many_messages(tmp_path / "a.mcap", 50_000)
    measurements = read_recording(path).measurements
    path.write_bytes(path.read_bytes()[:-1])
    recovered = read_recording(recover(path)).measurements
    np.testing.assert_array_equal(recovered.speed, measurements.speed)


def vehicle_log(
    path: Path, times_s: list[float], sent_before_s: float, leader_s: list[float] | None = None
) -> Path:
    """A vehicle's own motion at these times in order of recording, with a reception at every
    tenth. Messages were sent so long before by the leader's clock, which shows `leader_s` at these
    times, by default the same.

    The leader goes east at 1 m/s.
    """
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        motion, reception = (
            writer.register_channel(
                f"/auv/{kind.topic}", "protobuf", register_schema(writer, kind.message_class)
            )
            for kind in (OWN_MOTION, RECEPTION)
        )
        for k, time_s in enumerate(times_s):
            time_ns = round(1e9 * time_s)
            own = OWN_MOTION.message_class(speed=1.0, heading=0.0, depth=8.0)
            writer.add_message(motion, time_ns, own.SerializeToString(), time_ns)
            if k % 10 == 9:
                values = dict.fromkeys(RECEPTION.fields, 1.0)
                sent = (leader_s or times_s)[k] - sent_before_s
                values |= {"leader_timestamp": sent, "leader_east": 0.1 * k}
                values |= {"leader_heading": np.pi / 2}
                values |= dict.fromkeys(("range_rear", "range_front", "range_middle"), 30.0)
                writer.add_message(
                    reception,
                    time_ns,
                    RECEPTION.message_class(**values).SerializeToString(),
                    time_ns,
                )
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("leader_too", [True, False])
def test_a_clock_that_steps_back_while_it_records_is_corrected(
    tmp_path: Path, leader_too: bool
) -> None:
    """The measurements are those by a clock that does not step."""
    steady = [100.0 + 0.1 * k for k in range(200)]
    stepped = [*steady[:120], *(t - 5.03 for t in steady[120:])]
    leader = stepped if leader_too else steady
    recording = read_recording(vehicle_log(tmp_path / "a.mcap", stepped, 0.02, leader), "auv")
    (remark,) = recording.remarks
    clocks = "and the leader's clock step" if leader_too else "steps"
    # message 131 is the last of 120 own measurements and 12 receptions, counted from 0
    assert remark.startswith(
        f"the clock of /auv/motion {clocks} back by 5.03 s after message 131, 11.9 s after the "
        "first; later messages are shifted by as much, so that 0.1 s lie between"
    )
    by_steady_clock = read_recording(vehicle_log(tmp_path / "b.mcap", steady, 0.02), "auv")
    assert by_steady_clock.remarks == ()
    np.testing.assert_array_equal(
        recording.measurements.message_step, by_steady_clock.measurements.message_step
    )
    np.testing.assert_allclose(
        recording.measurements.message, by_steady_clock.measurements.message, atol=1e-6
    )
    assert recording.measurements.durations is None


def test_late_messages_are_no_steps_of_a_clock(tmp_path: Path) -> None:
    times = [100.0 + 0.1 * k for k in range(200)]
    with_late_messages = [*times[:50], *times[60:70], *times[50:60], *times[70:]]
    assert (
        read_recording(vehicle_log(tmp_path / "b.mcap", with_late_messages, 0.02), "auv").remarks
        == ()
    )


def test_a_log_whose_times_are_in_no_order_is_refused(tmp_path: Path) -> None:
    times = [100.0 + 0.1 * k for k in range(200)]
    np.random.default_rng(1).shuffle(times)
    with pytest.raises(
        LaisnError, match=r"steps back \d+ times, first after message \d+; messages"
    ):
        read_recording(vehicle_log(tmp_path / "c.mcap", times, 0.02), "auv")


def test_receptions_older_than_sound_needs_are_reported(tmp_path: Path) -> None:
    steady = [100.0 + 0.1 * k for k in range(200)]
    (remark,) = read_recording(vehicle_log(tmp_path / "a.mcap", steady, 2.02), "auv").remarks
    assert remark.startswith("messages of /auv/reception are 2 s older than sound needs (median)")
    for age in (0.02, 1e6, -3.0):
        assert read_recording(vehicle_log(tmp_path / "b.mcap", steady, age), "auv").remarks == ()
