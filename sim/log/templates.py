"""Templates of Jinja, whose compiled form is stored for later processes."""

from contextlib import suppress
from typing import Any

import jinja2

from laisn.compiled import FOLDER


def environment(**settings: Any) -> jinja2.Environment:
    """An environment with the project's settings and further ones.

    Compiling the templates of a report takes as long as all else of it. They are stored beside the
    machine code, in a folder that only this user can enter.
    """
    cache = None
    if FOLDER is not None:
        folder = FOLDER / "templates"
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            cache = _Cache(str(folder))
    return jinja2.Environment(
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        bytecode_cache=cache,
        **settings,
    )


class _Cache(jinja2.FileSystemBytecodeCache):
    """Jinja's cache in a folder, without which a page is made all the same."""

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Store a template; nothing if the folder cannot be written."""
        with suppress(OSError):
            super().dump_bytecode(bucket)
