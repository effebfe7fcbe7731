"""Settings of all tests."""

import os

from hypothesis import settings

# compiling on first use takes longer than any deadline; on a server every run tries the same examples
settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")
