"""Processes that end with the one that started them, however that ends."""

import os
import signal
import threading
import time

_LOOK_EVERY_S = 0.2


def end_with(parent: int) -> None:
    """End this process as soon as the process of that number, which started it, is gone; leave Ctrl-C to that one.

    A process that is killed can end nothing itself. To be called from the main thread.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()
