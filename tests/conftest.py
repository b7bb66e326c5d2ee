"""Settings of hypothesis for all tests."""

from hypothesis import settings

# The first call of a kernel may compile it. The same examples every time; new ones are looked for
# with --hypothesis-profile=explore.
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("fixed")
