"""Closed pipes, full disks, and machines that lack something."""

import shutil
import subprocess
import sys
from collections.abc import Iterator

from ..case import ANY, DRIVEN, DRIVING_S, FAILED, ONLY_REFUSED, REFUSED, Case
from ..good import BATCH, OUT, RUN

_GONE = (
    "import os, sys; r, w = os.pipe(); os.close(r); os.dup2(w, {number}); os.close(w); "
    "os.execvp(sys.argv[1], sys.argv[1:])"
)


def _without_reader(number: int) -> tuple[str, ...]:
    return (sys.executable, "-c", _GONE.format(number=number))


def _redirected(how: str) -> tuple[str, ...]:
    return ("sh", "-c", f'exec "$0" "$@" {how}')


STREAMS: dict[
    str, tuple[tuple[str, ...], bool]
] = {  # a prefix, and whether standard error can still be read
    "standard output without a reader": (_without_reader(1), True),
    "standard output closed": (_redirected(">&-"), True),
    "standard output full": (_redirected(">/dev/full"), True),
    "standard error without a reader": (_without_reader(2), False),
    "standard error closed": (_redirected("2>&-"), False),
    "standard error full": (_redirected("2>/dev/full"), False),
    "both closed": (_redirected(">&- 2>&-"), False),
    "both full": (_redirected(">/dev/full 2>/dev/full"), False),
    "all closed": (_redirected("<&- >&- 2>&-"), False),
    "standard input closed": (_redirected("<&-"), True),
}


READERS = ("report", "explain", "export")  # of recorded folders


def stream_cases() -> Iterator[Case]:
    """Standard output and error that are closed, full, or without a reader: what cannot be printed
    is a failure, what is wrong stays wrong."""
    report = ("report", "rec", "--out", "out")
    told: dict[str, tuple[str, ...]] = {
        "--help": ("--help",), "run --help": ("run", "--help"), "scenarios": ("scenarios",),
        "scenarios --json": ("scenarios", "--json"), "experiments": ("experiments",),
        "schema": ("schema",),
        "validate": ("validate", "good.yaml"), "run": RUN, "run --out": OUT[:-1],
        "listing": ("run", "good.sumocfg"), "batch": BATCH[:-1],
        "batch listing": ("batch", "one.yaml", "--dry-run"), "report": report,
        "explain": ("explain", "one", "--at", "1"), "export": ("export", "one", "--out", "x.csv"),
    }  # fmt: skip
    for how, (prefix, said) in STREAMS.items():
        printed = "output" in how or how.startswith(("both", "all"))
        for what, words in told.items():
            # Closed, not full: Python has no stream then, and printing nothing is no failure.
            allowed = (
                frozenset({FAILED})
                if printed and "closed" not in how
                else frozenset({DRIVEN, FAILED})
            )
            yield Case(
                "stream",
                f"{what}, {how}",
                words,
                recorded=words[0] in READERS,
                prefix=prefix,
                allowed=allowed,
                patience_s=DRIVING_S,
                said=said,
            )
        yield Case(
            "stream",
            f"wrong scenario, {how}",
            ("run", "nowhere.yaml"),
            prefix=prefix,
            allowed=ONLY_REFUSED,
            said=said,
        )
        yield Case(
            "stream",
            f"wrong option, {how}",
            ("run", "--tank"),
            prefix=prefix,
            allowed=ONLY_REFUSED,
            said=said,
        )


# --- disks ---


def _disk(size: str, where: str) -> tuple[str, ...]:
    """Starts the command where a folder is a disk of this size."""
    return (
        "unshare",
        "--mount",
        "sh",
        "-c",
        f'mount -t tmpfs -o size={size} none {where} && exec "$0" "$@"',
    )


def _can_mount() -> bool:
    """Whether this machine lets us have a disk of our own."""
    if shutil.which("unshare") is None:
        return False
    return (
        subprocess.run([*_disk("4k", "/mnt"), "true"], check=False, capture_output=True).returncode
        == 0
    )


def disk_cases() -> Iterator[Case]:
    """Disks that are full, at whatever file it happens, and limits of the process."""
    if _can_mount():
        yield from _full_disks()
    yield from _limits()


def _full_disks() -> Iterator[Case]:
    export = {
        f"export {form}": ("export", "one", "--format", form, "--out", "out/x")
        for form in ("csv", "fcd")
    }
    writes: dict[str, tuple[str, ...]] = {
        "run": OUT, "batch": BATCH, "report": ("report", "rec", "--out", "out", "--quiet"),
        "render": ("render", "one", "--out", "out/x.png"), **export,
    }  # fmt: skip
    for what, words in writes.items():
        for size in ("4k", "8k", "16k", "32k", "64k", "128k"):
            yield Case(
                "disk",
                f"{what} on {size}",
                words,
                recorded=True,
                prepare=lambda folder: (folder / "out").mkdir(),
                prefix=_disk(size, "out"),
                allowed=frozenset({DRIVEN, FAILED}),
                naming=("out",),
                patience_s=DRIVING_S,
            )
    for size in ("4k", "16k"):
        prefix = _disk(size, '"$TMPDIR"')
        yield Case(
            "disk",
            f"temporary folder on {size}",
            RUN,
            prefix=prefix,
            allowed=ANY,
            patience_s=DRIVING_S,
        )
        yield Case(
            "disk",
            f"temporary folder on {size}, batch",
            BATCH,
            prefix=prefix,
            allowed=ANY,
            patience_s=DRIVING_S,
        )


LIMITS = (
    "-f 0",
    "-f 8",
    "-n 6",
    "-n 12",
    "-n 24",
    "-u 1",
    "-v 2000000",
)  # of bash: file size, open files, processes, memory


def _limits() -> Iterator[Case]:
    for limit in LIMITS:
        # by way of a pipe: the limit is not for the file that takes what is said
        limited = f'(ulimit {limit}; exec "$0" "$@") 2>&1 | cat >&2'
        prefix = ("bash", "-c", f"set -o pipefail; {limited}")
        yield Case(
            "disk",
            f"limit {limit}",
            OUT,
            prefix=prefix,
            allowed=frozenset({DRIVEN, FAILED, REFUSED}),
            patience_s=DRIVING_S,
        )
