"""Settings of all tests."""

import signal

from hypothesis import HealthCheck, settings

# Compiling on first use takes longer than any deadline. Every run tries the same examples, so that a test that passes
# today passes tomorrow; `make fuzz` looks for others, and what it finds becomes an explicit example.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile(
    "fuzz", deadline=None, max_examples=2000, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")

# A shell that starts something in the background has it ignore Ctrl-C, and so would all that it starts; tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
