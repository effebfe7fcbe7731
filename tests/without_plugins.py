"""A stretch of a test with the plugins of a process that has just begun: none."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from laisn import plugins
from laisn.plugins import PLUGINS_VARIABLE, plugin_files


@contextmanager
def without_plugins() -> Iterator[None]:
    """No plugin is loaded or registered at the start of the block; those that it loads are
    forgotten after it, and those from before it are there again.
    """
    with pytest.MonkeyPatch.context() as patch:
        # set first, so that it is removed afterwards also if it was not there before
        patch.setenv(PLUGINS_VARIABLE, "")
        patch.delenv(PLUGINS_VARIABLE)
        patch.setattr(plugins, "_REGISTERED", {})
        patch.setattr(plugins, "_LOADED", {})
        path, modules = list(sys.path), set(sys.modules)
        try:
            yield
        finally:
            # also those that code in the block imports by their names, after a command loaded them
            loaded = {file.stem for file in (*plugin_files().values(), *plugins._IMPORTED)}
            for name in loaded - modules:
                sys.modules.pop(name, None)
            sys.path[:] = path
            os.environ.pop(PLUGINS_VARIABLE, None)
