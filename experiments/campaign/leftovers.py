"""What is written carries the number of its process until it is whole, so that others know what was left behind."""

import os


def writer_runs(number: str) -> bool:
    """Whether the process of this number still runs; no, if the text is no number."""
    try:
        os.kill(int(number), 0)
    except (ValueError, OverflowError, ProcessLookupError):
        return False
    except PermissionError:
        return True
    return True
