"""A seal in a file: whose content it is, and a hash of every byte, so that a file that is read back proves itself.

The seal is a line of text that the file's own format has room for: an entry of a Parquet file's metadata, or the
comment of a zip archive. Other programs read the file as ever.
"""

import hashlib

_START, _HASH, _DIGITS = b"laisn:", b" sha256:", 64


def blank(name: str) -> bytes:
    """The seal of a content of this name, to be put into the file once, before it is `sealed`."""
    return _START + name.encode() + _HASH + b"0" * _DIGITS


def sealed(content: bytes) -> bytes:
    """A file's bytes with the hash filled in; ValueError if there is no seal to fill in."""
    place = content.rfind(_HASH) + len(_HASH)
    if place < len(_HASH) or place + _DIGITS > len(content):
        raise ValueError("it has no seal")
    before, after = content[:place], content[place + _DIGITS :]
    digest = hashlib.sha256(before + b"0" * _DIGITS + after).hexdigest()
    return before + digest.encode() + after


def require_whole(content: bytes, name: str) -> None:
    """Raise ValueError unless these are the bytes that were sealed under this name."""
    if sealed(content) != content:
        raise ValueError("it is damaged: its content does not have its hash")
    if content.count(_START + name.encode() + _HASH) != 1:
        raise ValueError("it is another cell's, mission's or table's")
