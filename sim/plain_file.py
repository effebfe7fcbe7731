"""Text that a user names by the path of its file: refused before it is read if it is no plain file, or too large."""

import stat
from pathlib import Path

from laisn.failure import LaisnError


def text_of(path: Path, largest: int) -> str:
    """The text in a file, less a mark of the byte order at its start.

    Args:
        path: of the file; of a pipe or a device, a read could wait or go on for ever.
        largest: size that it may have [bytes].

    Raises:
        LaisnError: it cannot be read, is no plain file, is too large or no text; tells the reason alone, not the path.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise LaisnError("it is a folder" if stat.S_ISDIR(status.st_mode) else "it is no plain file")
        if status.st_size > largest:
            raise LaisnError(f"it has {status.st_size} bytes, there may be {largest}")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LaisnError(error.strerror or str(error)) from None
    except UnicodeDecodeError:
        raise LaisnError("not UTF-8 text") from None
    except LaisnError:
        raise
    except ValueError as error:
        raise LaisnError(str(error)) from None  # a NUL in the path
