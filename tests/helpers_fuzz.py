"""What fuzzing needs. Examples are as many as the profile says: 1000 and more with --hypothesis-profile=explore."""

from collections.abc import Callable

from sumo_mcts.errors import ConfigError

# What a number in a file may be replaced by.
HOSTILE = (
    "nan", "inf", "-inf", "0", "-1", "1e300", "-1e300", "1e-300", "", "x", "999999999", "99999999999999999999", "-999999999", ":", "1e", "é", "a b",
    "2147483648", "0x10", "true", ",", "0,0", "nan,nan nan,nan", "0,0 0,0", "1e300,1e300 0,0", "0,0 1e9,1e9",
)  # fmt: skip


def refusal(function: Callable[[], object]) -> str:
    """In which words a function refuses its input; "" where it takes it."""
    try:
        function()
    except ConfigError as error:
        return str(error)
    return ""
