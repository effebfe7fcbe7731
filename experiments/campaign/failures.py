"""Failures of campaigns and of stored results, which a user is told of in a line."""

from laisn.failure import LaisnError


class DamagedResult(UserWarning):
    """A stored result cannot be read; the text says which file, what is wrong with it, and what is done about it."""


class CampaignError(LaisnError):
    """A campaign cannot go on; every finished cell is stored."""
