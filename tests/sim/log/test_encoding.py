"""Messages that are written into the bytes of an example, against the SDK's own encoder."""

import numpy as np
import pytest
from foxglove import messages as fg

from sim.log.encoding import TimedNumbers, repeated
from sim.log.schema import pose, quaternion, timestamp, vector
from sim.log.writer import _transforms, poses

TIMES_NS = np.array([0, 1, 10**9, 1_700_000_000 * 10**9 + 123_456_789, 2_000_000_000_100_000_000])


def numbers_of_all_sizes(count: int, columns: int) -> np.ndarray:
    """Numbers of all sizes, with zeros of both signs, infinities and NaN among them."""
    rng = np.random.default_rng(2)
    numbers = rng.normal(size=(count, columns)) * 10.0 ** rng.integers(-300, 300, (count, columns))
    numbers[rng.uniform(size=numbers.shape) < 0.2] = 0.0
    numbers[0, 0], numbers[1, 1], numbers[2, 2] = -0.0, np.nan, -np.inf
    return numbers


def test_poses_are_those_of_the_sdk() -> None:
    times_ns = np.repeat(TIMES_NS, 40)
    positions_and_rotations = numbers_of_all_sizes(times_ns.size, 7)
    channel = poses(
        "/one", times_ns, positions_and_rotations[:, :3], positions_and_rotations[:, 3:]
    )
    expected = [
        fg.PoseInFrame(
            timestamp=timestamp(time_ns),
            frame_id="world",
            pose=pose(seven_numbers[:3], seven_numbers[3:]),
        ).encode()
        for time_ns, seven_numbers in zip(
            times_ns.tolist(), positions_and_rotations.tolist(), strict=True
        )
    ]
    assert list(channel.serialised(slice(None))) == expected
    assert list(channel.serialised(slice(37, 90))) == expected[37:90]


@pytest.mark.parametrize("children", [1, 3])
def test_transforms_are_those_of_the_sdk(children: int) -> None:
    """Also where the length of a message takes more than one byte."""
    times_ns = np.repeat(TIMES_NS, 10)
    positions_and_rotations = numbers_of_all_sizes(times_ns.size * children, 7).reshape(
        times_ns.size, children, 7
    )
    names = [f"vehicle {i} with a long name " + "x" * 60 for i in range(children)]
    parents = ["world"] * children
    channel = _transforms(
        "/tf",
        times_ns,
        parents,
        names,
        positions_and_rotations[..., :3],
        positions_and_rotations[..., 3:],
    )
    expected = [
        fg.FrameTransforms(
            transforms=[
                fg.FrameTransform(
                    timestamp=timestamp(time_ns),
                    parent_frame_id="world",
                    child_frame_id=name,
                    translation=vector(seven_numbers[:3]),
                    rotation=quaternion(seven_numbers[3:]),
                )
                for name, seven_numbers in zip(names, numbers_of_children, strict=True)
            ]
        ).encode()
        for time_ns, numbers_of_children in zip(
            times_ns.tolist(), positions_and_rotations.tolist(), strict=True
        )
    ]
    assert list(channel.serialised(slice(None))) == expected
    assert list(channel.serialised(slice(0, 0))) == []


def test_an_example_that_holds_a_number_twice_is_refused() -> None:
    """Numbers are written where they stand in an example: each must be there once."""

    def pose_with_a_number_twice(time_ns: int, numbers: object) -> bytes:
        message = fg.PoseInFrame(
            timestamp=timestamp(time_ns), frame_id="world", pose=pose((1.0, 1.0, 0.0))
        )
        return message.encode()

    with pytest.raises(AssertionError, match="does not stand in its message once"):
        TimedNumbers(pose_with_a_number_twice).rows(TIMES_NS[:1], np.ones((1, 1)))


def test_repeated_messages_have_their_lengths() -> None:
    """Tag 0x0A of field 1, then the length as a varint: seven bits a byte, the lowest first."""
    for length in (0, 1, 127, 128, 16_383, 16_384):
        encoded = repeated([b"a" * length])
        assert encoded[0] == 0x0A
        size, shift, index = 0, 0, 1
        while True:
            size |= (encoded[index] & 0x7F) << shift
            shift += 7
            index += 1
            if encoded[index - 1] < 0x80:
                break
        assert (size, len(encoded) - index) == (length, length)
