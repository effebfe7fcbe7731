"""A picture that stands for a film until it plays."""

from io import BytesIO
from pathlib import Path
from typing import Any

_QUALITY = 80


def poster(film: Path) -> bytes:
    """The key frame nearest before the middle of an H.264 film, as JPEG; the same film gives the same bytes.

    Raises:
        av.error.FFmpegError: the file is no film.
    """
    import av

    with av.open(str(film)) as source:
        stream = source.streams.video[0]
        source.seek((stream.duration or 0) // 2, stream=stream)
        frame: Any = next(source.decode(stream))
        picture = frame.to_image()
    target = BytesIO()
    picture.save(target, "JPEG", quality=_QUALITY, optimize=True)
    return target.getvalue()
