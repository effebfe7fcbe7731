"""Bytes read by compiled code: what protobuf and MCAP read, no more and no less, and quickly."""

import time
import zlib
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import register_schema
from synthetic import short_flight, write_log

from sim.log import wire
from sim.log.batches import records
from sim.log.contents import Messages, contents
from sim.log.file import LogError
from sim.log.reader import read_recording
from sim.log.records import HEAD, Budget, places
from sim.log.recovery import recover
from sim.log.schema import OWN_MOTION, RECEPTION
from sim.log.spool import Spool

KIND = descriptor_pb2.FieldDescriptorProto
INTEGERS = {
    "INT32": (-(2**31), 2**31 - 1), "INT64": (-(2**63), 2**63 - 1), "UINT32": (0, 2**32 - 1), "UINT64": (0, 2**64 - 1),
    "SINT32": (-(2**31), 2**31 - 1), "SINT64": (-(2**63), 2**63 - 1), "FIXED32": (0, 2**32 - 1),
    "FIXED64": (0, 2**64 - 1), "SFIXED32": (-(2**31), 2**31 - 1), "SFIXED64": (-(2**63), 2**63 - 1),
}  # fmt: skip
VALUES: dict[str, st.SearchStrategy[Any]] = {
    **{name: st.integers(*limits) for name, limits in INTEGERS.items()},
    "DOUBLE": st.floats(), "FLOAT": st.floats(width=32), "BOOL": st.booleans(), "STRING": st.text(max_size=5),
}  # fmt: skip
DEFAULTS = {"INT32": "-7", "DOUBLE": "2.5", "BOOL": "true", "STRING": "none"}


@cache
def message_class(syntax: str, *, numbers: bool = False) -> Any:
    """A type with a field of every kind, which also holds itself; or with numbers alone."""
    file = descriptor_pb2.FileDescriptorProto(name=f"all_{syntax}.proto", package=f"all_{syntax}", syntax=syntax)
    message = file.message_type.add(name="All")
    for number, name in enumerate(VALUES, start=1):
        if numbers and name == "STRING":
            continue
        default = DEFAULTS.get(name) if syntax == "proto2" else None
        message.field.add(
            name=name.lower(), number=number, type=KIND.Type.Value(f"TYPE_{name}"), label=KIND.LABEL_OPTIONAL,
            default_value=default,
        )  # fmt: skip
    if not numbers:
        label = KIND.LABEL_OPTIONAL
        message.field.add(name="inner", number=100, type=KIND.TYPE_MESSAGE, type_name=f".all_{syntax}.All", label=label)
        message.field.add(name="many", number=101, type=KIND.TYPE_DOUBLE, label=KIND.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"all_{syntax}.All"))


class Known(Messages):
    """Messages whose type need not be found in a schema."""

    def __init__(self, type_: Any, contents: list[bytes]) -> None:
        stop = np.cumsum([len(content) for content in contents], dtype=np.int64)
        super().__init__(None, "protobuf", np.zeros(len(contents), dtype=np.int64), stop, Spool(b"".join(contents)))
        self.descriptor = type_.DESCRIPTOR

    def texts(self, name: str) -> list[str]:
        return self.texts_in(self.stretch(slice(0, self.stop.size)), name)


ALL = st.fixed_dictionaries({}, optional={name.lower(): values for name, values in VALUES.items()})


def expected(message: Any, name: str) -> Any:
    for part in name.split("."):
        message = getattr(message, part)
    return message


@pytest.mark.parametrize("syntax", ["proto2", "proto3"])
@given(st.lists(st.tuples(ALL, st.none() | ALL, st.lists(st.floats(), max_size=2)), max_size=4))
def test_every_field_is_read_as_protobuf_reads_it(
    syntax: str, content: list[tuple[dict[str, Any], dict[str, Any] | None, list[float]]]
) -> None:
    type_ = message_class(syntax)
    inners = [None if inner is None else type_(**inner) for _, inner, _ in content]
    messages = [type_(**own, inner=inner, many=many) for (own, _, many), inner in zip(content, inners, strict=True)]
    read = Known(type_, [message.SerializeToString() for message in messages])
    for prefix in ("", "inner.", "inner.inner."):
        for name in (f"{prefix}{kind.lower()}" for kind in VALUES):
            found = read.texts(name) if name.endswith("string") else read.numbers(name).tolist()
            assert repr(found) == repr([expected(message, name) for message in messages])


@given(st.binary(max_size=30))
@example(b"\x5c")  # the end of a group
@example(b"\x00\x01")  # field 0
@example(b"\x2a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01")  # a length past all bytes
@example(b"\x08" + 9 * b"\xff" + b"\x7f")  # a number of more than 64 bits
@example(b"\x7a\x05")  # a text that is not there
@example(b"\x65\x00")  # a number of four bytes that has one
@example(b"\x08\x01\x10\x02\x08\x05")  # twice the same
def test_any_bytes_are_read_as_protobuf_reads_them_or_refused(data: bytes) -> None:
    # of texts and messages that were not asked for, nobody looks at what is inside
    type_ = message_class("proto3", numbers=True)
    try:
        message = type_.FromString(data)
    except DecodeError:
        message = None
    try:
        # what ends too early must not go on in the next one
        found = Known(type_, [data, 10 * b"\x08\x07"]).numbers("int32")[:1].tolist()
    except ValueError:
        # nobody writes groups, which protobuf skips
        assert message is None or any(byte & 7 in (3, 4) for byte in data)
    else:
        assert message is not None
        assert found == [message.int32]


def test_what_is_no_number_is_refused() -> None:
    read = Known(message_class("proto3"), [b""])
    for name, text in (("string", "holds no numbers"), ("inner", "holds no numbers"), ("many", "is a list")):
        with pytest.raises(ValueError, match=text):
            read.numbers(name)
    with pytest.raises(ValueError, match="holds no texts"):
        read.texts("double")


@pytest.mark.parametrize("chunks", [None, CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_messages_come_as_mcap_reads_them(tmp_path: Path, chunks: CompressionType | None) -> None:
    with write_log(short_flight(), tmp_path).open("rb") as stream:
        messages = [(c.topic, m) for _, c, m in make_reader(stream).iter_messages(log_time_order=False)]
    numbers = {topic: k for k, topic in enumerate(sorted({topic for topic, _ in messages}), start=1)}
    path = tmp_path / "again.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=chunks is not None, compression=chunks or CompressionType.NONE)
        writer.start()
        for topic in numbers:
            assert writer.register_channel(topic, "protobuf", 0) == numbers[topic]
        for topic, message in messages:
            writer.add_message(numbers[topic], message.log_time, message.data, message.log_time + 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with path.open("rb") as stream:
        found = [record for record in records(stream, Budget(10**8)) if isinstance(record, wire.Batch)]
    each = [item for batch in found for item in batch.each()]
    assert each == [(numbers[topic], m.log_time, m.log_time + 1, m.data) for topic, m in messages]
    for batch in found:
        for number, chosen in batch.by_channel():
            assert chosen.tolist() == np.flatnonzero(batch.channel == number).tolist()


@pytest.mark.parametrize("spooled", [False, True])
def test_messages_out_of_order_are_sorted_and_those_of_equal_time_stay_as_they_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spooled: bool
) -> None:
    if spooled:
        monkeypatch.setattr("sim.log.spool.IN_MEMORY", 100)
    monkeypatch.setattr("sim.log.contents._BYTES", 64)
    rng = np.random.default_rng(5)
    given_ = [(int(at), rng.bytes(int(size))) for at, size in rng.integers(0, 40, (200, 2))]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=500)
        writer.start()
        channel = writer.register_channel("/a", "", 0)
        for at, content in given_:
            writer.add_message(channel, at, content, at)
        writer.finish()  # type: ignore[no-untyped-call]
    found = contents(tmp_path / "a.mcap").topics["/a"]
    ordered = sorted(given_, key=itemgetter(0))
    assert found.time_ns.tolist() == [at for at, _ in ordered]
    assert list(found.each()) == [content for _, content in ordered]
    assert [p.stop - p.start for p in found.parts(1)] == [1] * 200
    for part in found.parts():
        # no more than 64 bytes, if it is more than one message
        assert part.stop == part.start + 1 or sum(len(content) for _, content in ordered[part]) <= 64


def test_without_room_for_what_a_log_unfolds_to_the_error_names_tmpdir(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.log.spool.IN_MEMORY", 100)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    with pytest.raises(LogError, match=r"no room for what the log unfolds to: No such file.*TMPDIR"):
        Spool(bytes(101))


def memory(what: str) -> int:
    """Memory of this process as the system counts it [bytes]."""
    status = Path("/proc/self/status").read_text()
    return next(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith(what))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells how much memory is in use")
def test_many_bytes_do_not_lie_in_the_memory() -> None:
    spool, block = Spool(), bytes(range(256)) * 4096
    before = memory("VmRSS")
    for _ in range(48):
        spool.append(block)
    assert memory("VmRSS") - before < 16e6
    assert spool.read(47 * len(block) + 5, 48 * len(block)).tobytes() == block[5:]


def many_messages(path: Path, count: int) -> Path:
    """A log of hours: own motion every 10 ms, at the speed of 1, 2, 3 … m/s; one has a heading."""
    first = OWN_MOTION.message_class(speed=1.0, heading=0.5).SerializeToString()
    content = OWN_MOTION.message_class(speed=1.0).SerializeToString()
    with path.open("wb") as stream:
        # without a summary nothing in the file says where something else lies
        writer = Writer(
            stream, enable_crcs=False, use_chunking=False, repeat_channels=False, repeat_schemas=False,
            use_statistics=False, use_summary_offsets=False, index_types=IndexType.NONE,
        )  # fmt: skip
        writer.start()
        for name, schema in (("motion", OWN_MOTION), ("reception", RECEPTION)):
            type_ = register_schema(writer, schema.message_class)
            writer.add_message(writer.register_channel(f"/follower/{name}", "protobuf", type_), 0, first, 0)
        writer.finish()  # type: ignore[no-untyped-call]
    written = path.read_bytes()
    with path.open("rb") as stream:
        end = next(place for place in places(stream) if place.opcode == Opcode.DATA_END).start - HEAD.size
    # Python's writer would take as long as all other tests of logs
    row = HEAD.pack(Opcode.MESSAGE, 22 + len(content)) + (1).to_bytes(2, "little") + bytes(20) + content
    rows = np.tile(np.frombuffer(row, dtype=np.uint8), (count, 1))
    rows[:, 15:23] = (10**7 * np.arange(1, count + 1, dtype="<i8")).view(np.uint8).reshape(count, 8)
    rows[:, 32:40] = np.arange(2.0, count + 2).view(np.uint8).reshape(count, 8)
    chunks = RecordBuilder()
    for start in range(0, count, 25_000):
        many = rows[start : start + 25_000].tobytes()
        Chunk("", many, 0, 0, zlib.crc32(many), len(many)).write(chunks)
    path.write_bytes(written[:end] + chunks.end() + written[end:])
    return path


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the peak of the memory can be reset on Linux")
def test_a_million_messages_take_little_time_and_memory(tmp_path: Path) -> None:
    path = many_messages(tmp_path / "a.mcap", 10**6)
    # code that is compiled takes its room once
    read_recording(many_messages(tmp_path / "b.mcap", 10), "follower")
    Path("/proc/self/clear_refs").write_text("5")
    before, begun = memory("VmRSS"), time.process_time()
    found = read_recording(path, "follower").measurements
    assert found.dt == 0.01
    np.testing.assert_array_equal(found.speed, np.arange(1.0, 10.0**6 + 2))
    assert np.flatnonzero(found.heading).tolist() == [0]
    assert time.process_time() - begun < 1.5
    # 24 are what remains, speed, heading and depth; as much again would be copies of them
    assert memory("VmHWM") - before < 70e6


def test_a_long_log_is_recovered_at_the_speed_of_reading(tmp_path: Path) -> None:
    path = many_messages(tmp_path / "a.mcap", 10**5)
    recover(many_messages(tmp_path / "b.mcap.partial", 10))
    begun = time.process_time()
    measurements = read_recording(path).measurements
    reading, begun = time.process_time() - begun, time.process_time()
    path.write_bytes(path.read_bytes()[:-1])
    recovered = recover(path)
    assert time.process_time() - begun < 8 * reading + 0.1
    again = read_recording(recovered).measurements
    # the last instant may not be whole
    np.testing.assert_array_equal(again.speed, measurements.speed[:-1])
