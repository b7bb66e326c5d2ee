"""Settings for all tests: hypothesis profiles, and the default handler of SIGHUP."""

import signal

from hypothesis import Phase, settings

# No deadline, since the first call of a kernel may compile it. The examples are the same every time;
# --hypothesis-profile=explore draws more and other ones.
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=2000)
# For `make mutants`: few examples, and none made smaller.
settings.register_profile(
    "brief",
    deadline=None,
    derandomize=True,
    max_examples=15,
    phases=(Phase.explicit, Phase.generate),
)
settings.load_profile("fixed")

# nohup lets processes ignore SIGHUP, and the processes that the tests start would inherit that.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
