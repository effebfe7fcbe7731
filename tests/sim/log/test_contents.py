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
VALUES: dict[str, st.SearchStrategy[Any]] = {
    **{name: st.integers(*limits) for name, limits in INTEGERS.items()},
    "DOUBLE": st.floats(),
    "FLOAT": st.floats(width=32),
    "BOOL": st.booleans(),
    "STRING": st.text(max_size=5),
}
DEFAULTS = {"INT32": "-7", "DOUBLE": "2.5", "BOOL": "true", "STRING": "none"}


@cache
def message_class(syntax: str, *, numbers: bool = False) -> Any:
    """A type with a field of every kind, which also holds itself; or with numbers alone."""
    file = descriptor_pb2.FileDescriptorProto(
        name=f"all_{syntax}.proto", package=f"all_{syntax}", syntax=syntax
    )
    message = file.message_type.add(name="All")
    for number, name in enumerate(VALUES, start=1):
        if numbers and name == "STRING":
            continue
        default = DEFAULTS.get(name) if syntax == "proto2" else None
        message.field.add(
            name=name.lower(),
            number=number,
            type=KIND.Type.Value(f"TYPE_{name}"),
            label=KIND.LABEL_OPTIONAL,
            default_value=default,
        )
    if not numbers:
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


def messages_of(type_: Any, written: list[bytes]) -> Messages:
    """Messages whose type need not be found in a schema."""
    result = Messages(None, data=written)
    result.message_class = type_
    return result


ALL = st.fixed_dictionaries({}, optional={name.lower(): values for name, values in VALUES.items()})


def expected(message: Any, name: str) -> Any:
    """What is set, by protobuf's own account; None for what has presence and is not set."""
    for part in name.split("."):
        if message.DESCRIPTOR.fields_by_name[part].has_presence and not message.HasField(part):
            return None
        message = getattr(message, part)
    return message


@pytest.mark.parametrize("syntax", ["proto2", "proto3"])
@given(
    st.lists(st.tuples(ALL, st.none() | ALL, st.lists(st.floats(), max_size=2)), max_size=4),
    st.integers(1, 3),
)
def test_every_field_is_read_as_protobuf_reads_it(
    syntax: str,
    content: list[tuple[dict[str, Any], dict[str, Any] | None, list[float]]],
    repeated: int,
) -> None:
    type_ = message_class(syntax)
    inners = [None if inner is None else type_(**inner) for _, inner, _ in content]
    written = [
        type_(**own, inner=inner, many=many)
        for (own, _, many), inner in zip(content, inners, strict=True)
    ]
    # a single message, repeated, has one length
    written *= repeated
    read = messages_of(type_, [message.SerializeToString() for message in written])
    for prefix in ("", "inner.", "inner.inner."):
        for name in (f"{prefix}{kind.lower()}" for kind in VALUES):
            (actual,) = read.columns([name])
            values = actual.tolist() if isinstance(actual, np.ndarray) else actual
            assert repr(values) == repr([expected(message, name) for message in written])


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
    rows: list[dict[str, Any]], text: str
) -> None:
    """A double and an integer take the same room: only the tag distinguishes them."""
    type_ = message_class("proto3")
    written = [type_(**row, string=text) for row in rows]
    read = messages_of(type_, [message.SerializeToString() for message in written])
    for name in (*NUMBERS, "string"):
        (actual,) = read.columns([name])
        assert repr(list(np.asarray(actual, dtype=object))) == repr(
            [expected(message, name) for message in written]
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
        assert actual.tolist() == [expected(message, name) for message in messages(path, topic)]


def test_what_is_no_value_is_refused() -> None:
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
    given_ = [(int(at), rng.bytes(int(size))) for at, size in rng.integers(0, 40, (200, 2))]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=500)
        writer.start()
        channel = writer.register_channel("/a", "", 0)
        for at, content in given_:
            writer.add_message(channel, at, content, at)
        writer.finish()  # type: ignore[no-untyped-call]
    actual = Contents(tmp_path / "a.mcap").topics["/a"]
    ordered = sorted(given_, key=itemgetter(0))
    assert actual.time_ns.tolist() == [at for at, _ in ordered]
    assert actual.data == [content for _, content in ordered]


def test_messages_from_a_time_on_are_left_out_whatever_the_order_of_recording(
    tmp_path: Path,
) -> None:
    recorded = [3, 9, 1, 5, 4, 8, 0, 5]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic in ("/data", "/times"):
            channel = writer.register_channel(topic, "", 0)
            for at in recorded:
                writer.add_message(channel, at, bytes([at]), at)
        writer.finish()  # type: ignore[no-untyped-call]
    contents = Contents(tmp_path / "a.mcap", lambda topic, _: topic == "/data")
    contents.cut(5)
    assert contents.topics["/data"].time_ns.tolist() == [0, 1, 3, 4]
    assert contents.topics["/data"].data == [bytes([at]) for at in (0, 1, 3, 4)]
    assert contents.topics["/times"].time_ns.tolist() == [3, 1, 4, 0]


def memory(what: str) -> int:
    """Memory of this process as the system counts it [bytes]."""
    status = Path("/proc/self/status").read_text()
    return next(
        1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith(what)
    )


def many_messages(path: Path, count: int) -> Path:
    """A log of hours: own motion every 10 ms, at the speed of 1, 2, 3 … m/s; one has a heading
    and an unknown field.
    """
    first = (
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
            data = first if name == "motion" else b""
            writer.add_message(
                writer.register_channel(f"/follower/{name}", "protobuf", type_), 0, data, 0
            )
        writer.finish()  # type: ignore[no-untyped-call]
    written = path.read_bytes()
    end = len(written) - 8 - 29 - 13
    # Python's writer would take as long as all other tests of logs
    row = (
        struct.pack("<BQ", Opcode.MESSAGE, 22 + len(content))
        + (1).to_bytes(2, "little")
        + bytes(20)
        + content
    )
    rows = np.tile(np.frombuffer(row, dtype=np.uint8), (count, 1))
    rows[:, 15:23] = (10**7 * np.arange(1, count + 1, dtype="<i8")).view(np.uint8).reshape(count, 8)
    rows[:, 32:40] = np.arange(2.0, count + 2).view(np.uint8).reshape(count, 8)
    chunks = RecordBuilder()
    for start in range(0, count, 25_000):
        many = rows[start : start + 25_000].tobytes()
        Chunk("", many, 0, 0, zlib.crc32(many), len(many)).write(chunks)
    path.write_bytes(written[:end] + chunks.end() + written[end:])
    return path


def seconds(call: Any) -> float:
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
    """Less than three times what the library takes for its records alone, and 300 bytes for a
    message.
    """
    path, n = many_messages(tmp_path / "a.mcap", 2 * 10**5), 2 * 10**5

    def records() -> None:
        with path.open("rb") as stream:
            assert (
                sum(
                    isinstance(r, Message) for r in StreamReader(stream, validate_crcs=True).records
                )
                == n + 2
            )

    read_recording(many_messages(tmp_path / "b.mcap", 10), "follower")
    Path("/proc/self/clear_refs").write_text("5")
    before = memory("VmRSS")
    actual = read_recording(path, "follower").measurements
    assert memory("VmHWM") - before < 300 * n
    assert actual.dt == 0.01
    np.testing.assert_array_equal(actual.speed, np.arange(1.0, n + 2))
    assert np.flatnonzero(actual.heading).tolist() == [0]
    assert seconds(lambda: read_recording(path, "follower")) < 3 * seconds(records)


@pytest.mark.system
def test_a_long_log_is_recovered(tmp_path: Path) -> None:
    path = many_messages(tmp_path / "a.mcap", 50_000)
    measurements = read_recording(path).measurements
    path.write_bytes(path.read_bytes()[:-1])
    again = read_recording(recover(path)).measurements
    np.testing.assert_array_equal(again.speed, measurements.speed)


def vehicle_log(
    path: Path, times_s: list[float], sent_before_s: float, leader_s: list[float] | None = None
) -> Path:
    """A vehicle's own motion at these times in order of recording, with a reception at every
    tenth, and the leader's clock at all of them, by default the same.

    The leader goes east at 1 m/s.
    """
    with path.open("wb") as stream:
        log = Writer(stream)
        log.start()
        motion, reception = (
            log.register_channel(
                f"/auv/{kind.topic}", "protobuf", register_schema(log, kind.message_class)
            )
            for kind in (OWN_MOTION, RECEPTION)
        )
        for k, time_s in enumerate(times_s):
            at = round(1e9 * time_s)
            own = OWN_MOTION.message_class(speed=1.0, heading=0.0, depth=8.0)
            log.add_message(motion, at, own.SerializeToString(), at)
            if k % 10 == 9:
                values = dict.fromkeys(RECEPTION.fields, 1.0)
                sent = (leader_s or times_s)[k] - sent_before_s
                values |= {"leader_timestamp": sent, "leader_east": 0.1 * k}
                values |= {"leader_heading": np.pi / 2}
                values |= dict.fromkeys(("range_rear", "range_front", "range_middle"), 30.0)
                log.add_message(
                    reception, at, RECEPTION.message_class(**values).SerializeToString(), at
                )
        log.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("leader_too", [True, False])
def test_a_clock_that_steps_back_while_it_records_is_corrected(
    tmp_path: Path, leader_too: bool
) -> None:
    """The measurements are those of a clock that goes on."""
    steady = [100.0 + 0.1 * k for k in range(200)]
    stepped = [*steady[:120], *(t - 5.03 for t in steady[120:])]
    leader = stepped if leader_too else steady
    recording = read_recording(vehicle_log(tmp_path / "a.mcap", stepped, 0.02, leader), "auv")
    (remark,) = recording.remarks
    clocks = "and the leader's clock step" if leader_too else "steps"
    # of 120 own measurements and 12 receptions
    assert remark.startswith(
        f"the clock of /auv/motion {clocks} back by 5.03 s after message 131, 11.9 s after the "
        "first; later messages are shifted by as much, so that 0.1 s lie between"
    )
    right = read_recording(vehicle_log(tmp_path / "b.mcap", steady, 0.02), "auv")
    assert right.remarks == ()
    np.testing.assert_array_equal(
        recording.measurements.message_step, right.measurements.message_step
    )
    np.testing.assert_allclose(
        recording.measurements.message, right.measurements.message, atol=1e-6
    )
    assert recording.measurements.durations is None


def test_late_messages_are_no_steps_of_a_clock(tmp_path: Path) -> None:
    steady = [100.0 + 0.1 * k for k in range(200)]
    late = [*steady[:50], *steady[60:70], *steady[50:60], *steady[70:]]
    assert read_recording(vehicle_log(tmp_path / "b.mcap", late, 0.02), "auv").remarks == ()


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
