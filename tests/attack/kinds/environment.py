"""Variables of the environment with values that make no sense."""

from collections.abc import Iterator

from ..case import ANY, DRIVING_S, Case

SEARCH = ("run", "good.yaml", "--planner", "mcts", "--iterations", "20", "--json")
COMPILING_S = 240.0  # where no compiled kernels are found

VARIABLES: dict[str, tuple[str | None, ...]] = {
    "HOME": (None, "", "/proc/nowhere", "/dev/null", "a\nb", "relative", "/proc", "x" * 3000),
    "XDG_CACHE_HOME": ("", "relative", "a\nb", "~"),
    "TMPDIR": ("/proc/nowhere", "/dev/null", "", "relative"),
    "SUMO_HOME": (None, "", "/proc/nowhere", "/dev/null", "a\nb", "."),
    "DISPLAY": ("", ":99", "nowhere:0", "a\nb"),
    "COLUMNS": ("", "0", "-1", "1", "x", "99999999999", "1e9"),
    "LINES": ("0", "x"),
    "LANG": ("", "C", "POSIX", "xx_XX", "tr_TR.UTF-8", "de_DE.ISO-8859-1", "a\nb"),
    "LC_ALL": ("", "C", "POSIX", "xx_XX.UTF-8", "en_US.ISO-8859-1", "x" * 3000),
    "LC_NUMERIC": ("de_DE.UTF-8",),
    "TERM": ("", "dumb", "x", "a\nb"),
    "NO_COLOR": ("", "1"),
    "FORCE_COLOR": ("", "1", "x"),
    "TZ": ("", "x", "Nowhere/Town", "UTC+99"),
    "PATH": ("", "/proc/nowhere"),
    "MPLBACKEND": ("x", "TkAgg"),
    "MPLCONFIGDIR": ("/proc/nowhere/x", "/dev/null"),
    "PROJ_LIB": ("/proc/nowhere",),
    "SOURCE_DATE_EPOCH": ("x", "-1"),
}
COMPILER: dict[str, tuple[str, ...]] = {
    "XDG_CACHE_HOME": ("/proc/nowhere/x", "/dev/null/x", "/proc/x"),
    "NUMBA_CACHE_DIR": ("/proc/nowhere/x", "/dev/null"),
    "NUMBA_NUM_THREADS": ("0", "x", "99999"),
    "NUMBA_THREADING_LAYER": ("x",),
    "NUMBA_DISABLE_JIT": ("x",),
    "NUMBA_OPT": ("x", "9"),
    "NUMBA_DEBUG_CACHE": ("x",),
}
_LISTED = ("scenarios", "--json")
_DRAWN = ("run", "good.yaml", "--out", "out", "--json")


def cases() -> Iterator[Case]:
    """Variables of the environment with values that make no sense.

    Most commands do not need them, and go on.
    """
    for name, values in VARIABLES.items():
        for value in values:
            for words in (_LISTED, _DRAWN):
                yield Case(
                    "environment",
                    f"{name}={value!r:.30}, {words[0]}",
                    words,
                    environment={name: value},
                    allowed=ANY,
                    patience_s=DRIVING_S,
                )
    for name, values in COMPILER.items():
        for value in values:
            yield Case(
                "environment",
                f"{name}={value!r:.30}, search",
                SEARCH,
                environment={name: value},
                allowed=ANY,
                patience_s=COMPILING_S,
            )
    for display, naming in ((None, "display"), ("nowhere:9", "")):
        yield Case(
            "environment",
            f"--gui, DISPLAY={display!r}",
            ("run", "good.yaml", "--gui"),
            environment={"DISPLAY": display},
            naming=(naming,),
        )
