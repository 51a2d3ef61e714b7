"""What all tests need of the process that they run in."""

import signal
import threading

from hypothesis import settings

# The second is for changes of what it tests: pytest --hypothesis-profile thorough PATH.
settings.register_profile("fast", max_examples=50)
settings.register_profile("thorough", max_examples=1000)
settings.load_profile("fast")

# A shell ignores interrupts for what it starts in the background, and processes started here would inherit that.
if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
