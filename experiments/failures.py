"""Failures that are not the user's input: the program's own, told apart from what a user can mend in a scenario."""

_PACKAGES = {"laisn", "sim", "experiments"}


class DamagedResult(UserWarning):
    """A stored result cannot be read; the text says which file, what is wrong with it, and what is done about it."""


class CampaignError(RuntimeError):
    """A campaign cannot go on; every finished cell is stored."""


def is_own(error: BaseException) -> bool:
    """Whether a class of this project says what happened; any other exception is a fault of the program."""
    return type(error).__module__.partition(".")[0] in _PACKAGES
