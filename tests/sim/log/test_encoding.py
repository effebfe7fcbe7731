"""Messages that are written into the bytes of an example, against the SDK's own encoder."""

import numpy as np
import pytest
from foxglove import messages as fg

from sim.log.encoding import TimedNumbers, repeated
from sim.log.schema import pose, quaternion, timestamp, vector
from sim.log.writer import _transforms, poses

TIMES = np.array([0, 1, 10**9, 1_700_000_000 * 10**9 + 123_456_789, 2_000_000_000_100_000_000])


def numbers_of(count: int, columns: int) -> np.ndarray:
    """Numbers of all sizes, with zeros of both signs, infinities and NaN among them."""
    rng = np.random.default_rng(2)
    numbers = rng.normal(size=(count, columns)) * 10.0 ** rng.integers(-300, 300, (count, columns))
    numbers[rng.uniform(size=numbers.shape) < 0.2] = 0.0
    numbers[0, 0], numbers[1, 1], numbers[2, 2] = -0.0, np.nan, -np.inf
    return numbers


def test_poses_are_those_of_the_sdk() -> None:
    time = np.repeat(TIMES, 40)
    numbers = numbers_of(time.size, 7)
    channel = poses("/one", time, numbers[:, :3], numbers[:, 3:])
    expected = [
        fg.PoseInFrame(
            timestamp=timestamp(at), frame_id="world", pose=pose(row[:3], row[3:])
        ).encode()
        for at, row in zip(time.tolist(), numbers.tolist(), strict=True)
    ]
    assert list(channel.serialised(slice(None))) == expected
    assert list(channel.serialised(slice(37, 90))) == expected[37:90]


@pytest.mark.parametrize("children", [1, 3])
def test_transforms_are_those_of_the_sdk(children: int) -> None:
    """Also where a message is longer than a byte can say."""
    time = np.repeat(TIMES, 10)
    numbers = numbers_of(time.size * children, 7).reshape(time.size, children, 7)
    names = [f"vehicle {i} with a long name " + "x" * 60 for i in range(children)]
    parents = ["world"] * children
    channel = _transforms("/tf", time, parents, names, numbers[..., :3], numbers[..., 3:])
    expected = [
        fg.FrameTransforms(
            transforms=[
                fg.FrameTransform(
                    timestamp=timestamp(at),
                    parent_frame_id="world",
                    child_frame_id=name,
                    translation=vector(row[:3]),
                    rotation=quaternion(row[3:]),
                )
                for name, row in zip(names, rows, strict=True)
            ]
        ).encode()
        for at, rows in zip(time.tolist(), numbers.tolist(), strict=True)
    ]
    assert list(channel.serialised(slice(None))) == expected
    assert list(channel.serialised(slice(0, 0))) == []


def test_an_example_with_ambiguous_numbers_is_noticed() -> None:
    def twice(at: int, numbers: object) -> bytes:
        message = fg.PoseInFrame(
            timestamp=timestamp(at), frame_id="world", pose=pose((1.0, 1.0, 0.0))
        )
        return message.encode()

    with pytest.raises(AssertionError, match="does not stand in its message once"):
        TimedNumbers(twice).rows(TIMES[:1], np.ones((1, 1)))


def test_repeated_messages_have_their_lengths() -> None:
    for length in (0, 1, 127, 128, 16_383, 16_384):
        joined = repeated([b"a" * length])
        assert joined[0] == 0x0A
        size, shift, at = 0, 0, 1
        while True:
            size |= (joined[at] & 0x7F) << shift
            shift += 7
            at += 1
            if joined[at - 1] < 0x80:
                break
        assert (size, len(joined) - at) == (length, length)
