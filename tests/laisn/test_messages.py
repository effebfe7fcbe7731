"""Parts of the messages that a follower received over a further link."""

import numpy as np
import pytest

from laisn.messages import LinkMessages


@pytest.mark.parametrize(
    ("first", "last", "steps"),
    [(0, 40, [1, 10, 11, 30]), (1, 30, [10, 11, 30]), (10, 29, [11]), (30, 40, [])],
)
def test_a_part_of_a_link_has_the_messages_of_its_steps_counted_from_its_start(
    first: int, last: int, steps: list[int]
) -> None:
    """Steps `first` + 1 … `last`, both included."""
    index = np.arange(4.0)
    link = LinkMessages(
        message_step=np.array([1, 10, 11, 30]),
        message=np.tile(index[:, None], 10),
        ranges=np.tile(index[:, None], 3),
        round_trip=index,
        content={"ctd": index[:, None]},
    )
    part = link.part(first, last)
    expected = [[1, 10, 11, 30].index(step) for step in steps]
    assert part.message_step.tolist() == [step - first for step in steps]
    for values in (
        part.message[:, 0],
        part.ranges[:, 2],
        part.round_trip,
        part.content["ctd"][:, 0],
    ):
        assert np.asarray(values).tolist() == expected
