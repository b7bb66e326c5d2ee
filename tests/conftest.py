"""Settings for all tests: of hypothesis, and signals as a terminal leaves them."""

import signal

from hypothesis import settings

# The first call of a kernel may compile it. The same examples every time; new ones are looked for
# with --hypothesis-profile=explore.
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("fixed")

# Under nohup it is ignored, by all processes that the tests start too.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
