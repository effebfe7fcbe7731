"""The one base of all exceptions that a user can do something about: on the ground floor, for every room raises it."""


class LaisnError(ValueError):
    """What was given cannot be used, or the machine lacks something; the text says what was expected and what exists.

    The command shows the text alone. Any other exception is a bug. It is a `ValueError`, so that
    whoever calls a function from Python may catch it without knowing this class.
    """
