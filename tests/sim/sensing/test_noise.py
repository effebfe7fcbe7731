"""Noise: the generator against published answers, its distributions against closed-form bounds."""

import math
from itertools import product

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from laisn.compiled import compiled
from sim.scenario.formation import MAX_FOLLOWERS
from sim.sensing import noise
from sim.sensing.noise import Address, Stream, normals, uniforms

DRAWS = 200_000
STEPS = np.arange(DRAWS)

KNOWN_ANSWERS = [
    # Counter, key, output: known-answer vectors published with Random123 1.14 (kat_vectors,
    # "philox4x32 10").
    (
        "00000000 00000000 00000000 00000000",
        "00000000 00000000",
        "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
    ),
    (
        "ffffffff ffffffff ffffffff ffffffff",
        "ffffffff ffffffff",
        "408f276d 41c83b0e a20bc7c6 6d5451fd",
    ),
    (
        "243f6a88 85a308d3 13198a2e 03707344",
        "a4093822 299f31d0",
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]


@compiled
def _philox(words: npt.NDArray[np.uint64]) -> tuple[int, int, int, int]:
    return noise.philox(words[0], words[1], words[2], words[3], words[4], words[5])


@pytest.mark.parametrize(("counter", "key", "output"), KNOWN_ANSWERS)
def test_philox_gives_the_published_outputs(counter: str, key: str, output: str) -> None:
    words = np.array([int(word, 16) for word in f"{counter} {key}".split()], dtype=np.uint64)
    assert [int(word) for word in _philox(words)] == [int(word, 16) for word in output.split()]


def test_normals_drawn_ahead_are_those_of_each_step() -> None:
    for seed, run, follower, first in ((7, 3, 2, 0), (2**63 + 5, 2**31, 40, 12345)):
        drawn = np.zeros(2 * noise.STEPS_AHEAD)
        noise.draw_ahead(Address(*noise.seed_and_run(seed, run), follower, first), 6, drawn)
        steps = first + np.arange(noise.STEPS_AHEAD)
        expected = normals(seed, run, Stream.GYRO.number(follower), steps)
        np.testing.assert_array_equal(drawn.reshape(2, -1).T, expected)


def test_normals_are_those_of_box_and_muller() -> None:
    # The words of an address by the published algorithm of Philox 4x32-10 in Python's integers, the
    # normals by the functions of `math`.
    def words(seed: int, run: int, stream: int, step: int, block: int = 0) -> list[int]:
        c, k = [step, run, stream, block], [seed & 0xFFFFFFFF, seed >> 32]
        for _ in range(10):
            p0, p1 = c[0] * 0xD2511F53, c[2] * 0xCD9E8D57
            c = [
                (p1 >> 32) ^ c[1] ^ k[0],
                p1 & 0xFFFFFFFF,
                (p0 >> 32) ^ c[3] ^ k[1],
                p0 & 0xFFFFFFFF,
            ]
            k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
        return c

    seed, run, stream = 2**63 + 12345, 17, Stream.OWN_MOTION.number(3)
    blocks = [normals(seed, run, stream, np.arange(50), block) for block in range(3)]
    for block, step in product(range(3), range(50)):
        first, second = blocks[block][step]
        output_words = words(seed, run, stream, step, block)
        u, v = ((high << 20) | (low >> 12) for high, low in (output_words[:2], output_words[2:]))
        radius = math.sqrt(-2.0 * math.log(1.0 - u * 2.0**-52))
        angle = (v * 2.0**-52 - 0.5) * math.pi / 2 + (v % 4) * math.pi / 2
        assert first == pytest.approx(radius * math.cos(angle), abs=1e-13)
        assert second == pytest.approx(radius * math.sin(angle), abs=1e-13)
    assert uniforms(seed, run, stream, 5)[0] == pytest.approx(
        [(output_words + 0.5) * 2.0**-32 for output_words in words(seed, run, stream, 5)], abs=1e-16
    )


def test_normals_have_the_moments_and_the_distribution_of_normals() -> None:
    # Bounds are five standard errors: variances of the sample moments of a normal are 1, 2, 15 and
    # 96 over the number.
    draws = normals(1, 0, 0, STEPS)
    for column in draws.T:
        for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
            assert abs(np.mean(column**power) - moment) < 5 * math.sqrt(variance / DRAWS)
        # Kolmogorov's limit: the distance exceeds 1.95 / √m once in a thousand samples.
        assert stats.kstest(column, "norm").statistic < 1.95 / math.sqrt(DRAWS)
    assert abs(np.mean(draws[:, 0] * draws[:, 1])) < 5 / math.sqrt(DRAWS)
    assert abs(np.mean(draws[:, 0] ** 2 * draws[:, 1] ** 2) - 1) < 5 * math.sqrt(8 / DRAWS)


def test_uniforms_are_uniform() -> None:
    draws = uniforms(1, 0, Stream.RANGE_UNIFORM.number(), STEPS)
    assert draws.min() > 0.0
    assert draws.max() < 1.0
    for column in draws.T:
        assert stats.kstest(column, "uniform").statistic < 1.95 / math.sqrt(DRAWS)
    correlation = np.corrcoef(draws.T) - np.eye(4)
    assert np.abs(correlation).max() < 5 / math.sqrt(DRAWS)


def test_different_addresses_are_independent() -> None:
    streams = [stream.number(follower) for stream in Stream for follower in (0, 1)]
    addresses = {(1, 0, stream) for stream in streams} | {
        (2, 0, 0),
        (1, 1, 0),
        (1, 2, 0),
        (1 + 2**32, 0, 0),
    }
    draws = np.concatenate([normals(*address, STEPS).T for address in sorted(addresses)])
    draws = np.concatenate([draws, normals(1, 0, 0, STEPS + 1).T])
    covariance = draws @ draws.T / DRAWS - np.eye(len(draws))
    # One pair of rows is the same noise a step later; all others, and this one, must be
    # uncorrelated.
    assert np.abs(covariance).max() < 5 / math.sqrt(DRAWS)


def test_a_draw_is_the_same_alone_and_among_others() -> None:
    together = normals(5, 3, 2, STEPS[:100])
    alone = np.concatenate([normals(5, 3, 2, step) for step in range(99, -1, -1)])[::-1]
    assert together.tobytes() == alone.tobytes()


def test_followers_share_the_noise_of_the_leader_only() -> None:
    stream_numbers = [stream.number(follower) for stream in Stream for follower in range(50)]
    leader = {s for s in Stream if s.name.startswith("LEADER")}
    assert len(set(stream_numbers)) == len(leader) + 50 * (len(Stream) - len(leader))
    assert all(s.number(0) == s.number(49) for s in leader)


@pytest.mark.parametrize(
    ("seed", "run", "stream", "steps", "faulty_part"),
    [
        (-1, 0, 0, 0, "seed"),
        (2**64, 0, 0, 0, "seed"),
        (0, 2**32, 0, 0, "run"),
        (0, 0, -1, 0, "stream"),
    ],
)
def test_the_part_of_an_address_that_is_out_of_range_is_named(
    seed: int, run: int, stream: int, steps: int, faulty_part: str
) -> None:
    with pytest.raises(ValueError, match=faulty_part):
        normals(seed, run, stream, steps)


def test_no_two_kinds_of_noise_share_a_stream() -> None:
    assert (
        len({int(stream) for stream in Stream.__members__.values()}) == len(Stream.__members__) > 8
    )


def test_no_two_receivers_share_a_number_and_all_hear_the_same_leader() -> None:
    """For the most followers and the leader, on as many links as a scenario may have: streams of
    receivers and of looks at vehicles nearby differ, errors of the leader's motion are the same for
    all receivers.
    """
    links = range(1 + 1 + 8)  # the main one, the leader's broadcast beside it, and those of tables
    receivers = [*range(MAX_FOLLOWERS), noise.LEADER_NUMBER]
    assert len(links) <= noise.MAX_LINKS
    numbers = [link * noise.RECEIVERS + receiver for link in links for receiver in receivers]
    streams_of_looks = [
        noise.number_of_look(follower, vehicle)
        for follower in range(MAX_FOLLOWERS)
        for vehicle in range(MAX_FOLLOWERS + 1)
    ]
    streams_of_receivers = [
        noise.STREAMS * number + stream for number in numbers for stream in range(Stream.NEARBY)
    ]
    assert len(set(streams_of_receivers)) == len(streams_of_receivers)
    assert len(set(streams_of_looks)) == len(streams_of_looks)
    assert set(streams_of_receivers).isdisjoint(streams_of_looks)
    assert noise.number_of_look(3, 5) == noise.STREAMS * 3 + Stream.NEARBY + 5
    for link in links:
        addresses = [
            Address(np.uint64(1), np.uint64(0), link * noise.RECEIVERS + receiver, 7)
            for receiver in receivers
        ]
        assert len({noise.normals_at(address, Stream.LEADER_MOTION) for address in addresses}) == 1
        assert len({noise.normals_at(address, Stream.DEPTH) for address in addresses}) == len(
            receivers
        )
