"""Base classes of the errors and warnings that users can act on."""


class LaisnError(ValueError):
    """What was given cannot be used, or the machine lacks something; the text states what was expected and what exists.

    The command shows the text alone. Any other exception is a bug. It is a `ValueError`, so that
    callers from Python may catch it without knowing this class.
    """


class LaisnWarning(UserWarning):
    """A problem that was worked around; the command shows the text alone, and no warnings of libraries."""
