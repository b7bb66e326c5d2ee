"""Wrong words on the command line: every option of every command, keys of --set, and what follows
--."""

import functools
import inspect
import os
import socket
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from typer.models import OptionInfo

from sumo_mcts import cli

from ..case import ANY, DRIVING_S, NOT_DRIVEN, Case, nothing

LONG = "x" * 100_000
TEXTS = ("", " ", "a\nb", "\x1b[31mred", "-", "--", "../..", "%s%n", "ä\u202e", "x" * 300, LONG)
NUMBERS = (
    "",
    "x",
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e400",
    "9" * 400,
    "0x10",
    "1,5",
    "true",
    "٣",
)
PATHS = (
    "",
    "\n",
    "/dev/null",
    "/dev/null/x",
    "/dev/full",
    "/proc/x",
    "/sys/x",
    "good.yaml",
    "good.yaml/x",
    "x" * 300,
    "a/" * 3000,
    "\x1b[31mred",
    "-",
    "~nobody/x",
)

# What a command needs beside the option under attack: little to do, should the option be taken.
BESIDE: dict[str, tuple[str, ...]] = {
    "run": ("run", "good.yaml", "--quiet"),
    "forecast": ("forecast", "nowhere.yaml", "--quiet"),
    "drivers": ("drivers", "nowhere.yaml", "--quiet"),
    "regret": ("regret", "nowhere.yaml", "--quiet"),
    "value": ("value", "nowhere.yaml", "--quiet"),
    "batch": ("batch", "exp1.yaml", "--jobs", "1", "--out", "out", "--quiet"),
    # one of the two is refused, whichever option is attacked: it would drive for long
    "article": ("article", "--jobs", "0", "--out", "good.yaml/x", "--quiet"),
    "report": ("report", "nowhere"),
    "render": ("render", "nowhere"),
    "export": ("export", "nowhere"),
    "explain": ("explain", "nowhere"),
    "validate": ("validate", "nowhere.yaml"),
}
SCHEDULER_S = 45.0  # one that does not answer is given up after 20 s
EXPERIMENT = b"name: exp1\nscenarios: [good.yaml]\n"


class Option(NamedTuple):
    """An option of a command."""

    name: str  # with its dashes
    kind: type  # of the value; bool: a flag without one


def cases() -> Iterator[Case]:
    """Every option with values that make no sense, as far as it takes one; arguments too many, too
    few, unknown."""
    for name, function in sorted(commands().items()):
        beside = BESIDE.get(name, (name, "nowhere") if takes_argument(function) else (name,))
        for option in options(function):
            if option.kind is not bool:
                yield from _values(name, beside, option)
        yield from _counts(name, beside)
    yield from scheduler_cases()
    for words in (
        ("tank",),
        ("--tank",),
        ("-x",),
        ("",),
        ("run run",),
        ("RUN",),
        ("\n",),
        ("\x1b[31mrun",),
        ("--",),
        ("-",),
        (LONG,),
    ):
        yield Case("option", f"the command {words[0][:20]!r}", words)


def scheduler_cases() -> Iterator[Case]:
    """Addresses at which no scheduler answers."""
    for address in (
        silent_address(),
        "tcp://127.0.0.1:1",
        "tcp://nowhere.invalid:8786",
        "127.0.0.1",
        "tank://127.0.0.1:1",
        "tcp://127.0.0.1:99999",
        "tcp://",
        "tcp://[::1",
    ):
        words = ("batch", "one.yaml", "--out", "out", "--quiet", "--scheduler", address)
        name = "a silent address" if address == silent_address() else repr(address)
        yield Case(
            "option",
            f"batch --scheduler, {name}",
            words,
            allowed=NOT_DRIVEN,
            naming=("--scheduler",),
            patience_s=SCHEDULER_S,
        )


@functools.cache
def _silent() -> socket.socket:
    """Takes connections, as long as this process lives, and never answers."""
    return socket.create_server(("127.0.0.1", 0), backlog=64)


def silent_address() -> str:
    """Where a program listens that says nothing."""
    return f"tcp://127.0.0.1:{_silent().getsockname()[1]}"


def commands() -> dict[str, Callable[..., Any]]:
    """The functions of all commands, by name."""
    found = {
        info.name or getattr(info.callback, "__name__", ""): info.callback
        for info in cli.app.registered_commands
    }
    return {name: function for name, function in found.items() if function is not None}


def options(function: Callable[..., Any]) -> Iterator[Option]:
    """The options of a command."""
    for name, hint in typing.get_type_hints(function, include_extras=True).items():
        infos = [info for info in getattr(hint, "__metadata__", ()) if isinstance(info, OptionInfo)]
        for info in infos:
            plain = _plain(typing.get_args(hint)[0])
            # In Annotated the first name of an option stands where typer keeps a default.
            declared = [
                str(word)
                for word in (info.default, *(info.param_decls or ()))
                if str(word).startswith("--")
            ]
            yield Option(declared[0] if declared else f"--{name.replace('_', '-')}", plain)


def takes_argument(function: Callable[..., Any]) -> bool:
    """Whether a command has words of its own beside options."""
    return len(inspect.signature(function).parameters) > len(list(options(function)))


def _plain(hint: Any) -> type:
    """The type in Optional[list[T]]."""
    while typing.get_args(hint):
        hint = next(part for part in typing.get_args(hint) if part is not type(None))
    return hint if isinstance(hint, type) else str


def set_cases() -> Iterator[Case]:
    """Assignments that are none, or of keys that are none."""
    wrong = (
        "", "=", "=1", "planner", "planner=", "planner=1", ".=1", "..=1", ".planner=1",
        "planner.=1", "planner..name=idm", "planner.name.x=1", "planer.name=idm",
        "planner.iterations=",
        "planner.iterations=[", "planner.iterations={", "planner.iterations=many",
        "planner.iterations=1.5", "planner.iterations=true", "planner.iterations=null",
        "planner.iterations=[1]",
        "planner.iterations=1e3", "planner.iterations=!!python/name:os.system",
        "planner.iterations=*a", "planner.iterations=2001-99-99", "planner.iterations=!!int x",
        "cost.jerk=.nan",
        "cost.jerk=.inf", "cost.jerk=-1", f"cost.jerk={'9' * 5000}", f"cost={'[' * 100_000}",
        f"cost={'{a: ' * 2000}", f"{'a.' * 20_000}b=1", "egos=[]", "egos=ego", "egos.0.id=nobody",
        "egos.x.id=1", "traffic.actors.9.id=x", "traffic.actors.-1.id=x", "traffic.actors=[]",
        "name=", "name=a/b", "sumo.net=nowhere", "sumo.net=", "sumo.routes=nowhere", "sumo={}",
        "a\nb=1", "\x1b[31mred=1", "planner.name=a\nb", "planner.name=\x1b[31mred",
        "planner.name=os:system", "base=good.yaml", "planner.name=mcts\n---\nidm",
        "planner.options={a: .nan}",
        "episode.time_limit_s=0", "episode.time_limit_s=1e-320", "sumo.step_length_s=1e-9",
        "sumo.step_length_s=1e9", "sumo.step_length_s=0.0001", "planner.period_s=1e9",
        "planner.period_s=1e-9",
        "episode.depart_limit_s=1e-9", "sensor.range_m=1e-9", "sensor.range_m=1e300",
        "planner.accelerations_mps2=[]", "planner.accelerations_mps2=[.nan]",
        "description=a: b: c",
    )  # fmt: skip
    taken = (
        "planner.name=mcts\n---\nidm", "sumo.step_length_s=", "planner.period_s=", "episode.",
        "sensor.range_m=1e-9", "planner.options=", "planner=", "traffic.actors=[]", "cost={",
        "description=",
        "planner.iterations=1e3",
        "egos.0.id",
    )  # fmt: skip
    for number, assignment in enumerate(wrong):
        allowed = (
            ANY if assignment.startswith(taken) and assignment != "planner=1" else frozenset({2})
        )
        yield Case(
            "set",
            f"{number} {assignment!r:.50}",
            ("run", "good.yaml", "--json", "--set", assignment),
            allowed=allowed,
            patience_s=DRIVING_S if 0 in allowed else 20.0,
        )


SUMO_OPTIONS: tuple[tuple[str, ...], ...] = (
    ("help",), ("--help",), ("-?",), ("--version",), ("-V",), ("--save-configuration", "x"),
    ("-C", "x.sumocfg"), ("--save-template", "x"), ("--save-schema", "x"), ("--save-commented",),
    ("save-configuration", "x"), ("--remote-port", "9393"), ("--remote-port=9393",),
    ("--num-clients", "2"), ("--remote-port", "99999999"),
    ("--configuration-file", "good.sumocfg"), ("-c", "good.sumocfg"),
    ("-n", "net.net.xml"), ("--net-file=x",), ("--route-files", "nowhere.xml"), ("-r", "pipe"),
    ("--route-files", "pipe"), ("--additional-files", "pipe"), ("-a", "/dev/zero"),
    ("--weight-files", "pipe"),
    ("--load-state", "pipe"), ("--load-state", "nowhere"), ("--load-state", "net.net.xml"),
    ("--gui-settings-file", "pipe"), ("--tracker-interval", "x"),
    ("--begin", "x"), ("--begin", "-1"), ("--begin", "1e300"), ("--begin", "99999999"),
    ("--end", "0"), ("--end", "-5"), ("--end", "x"), ("--end", "nan"),
    ("--begin", "100", "--end", "10"),
    ("--step-length", "x"), ("--step-length", "-1"), ("--step-length", "1e9"),
    ("--step-length", "0.001"), ("--step-length", "0.00001"), ("--step-length", "nan"),
    ("--step-length", "inf"), ("--step-length", "100"),
    ("--lateral-resolution", "0.0001"), ("--lateral-resolution", "-1"),
    ("--lateral-resolution", "nan"), ("--lateral-resolution", "1e300"),
    ("--lanechange.duration", "-1"), ("--lanechange.duration", "1e9"),
    ("--seed", "x"), ("--seed", "-1"), ("--seed", "9" * 30), ("--random",),
    ("--threads", "100000"), ("--threads", "-1"), ("--threads", "x"), ("--thread-rngs", "0"),
    ("--thread-rngs", "-1"), ("--scale", "-1"),
    ("--scale", "1e9"), ("--scale", "nan"), ("--time-to-teleport", "0.1"),
    ("--max-depart-delay", "0"), ("--max-num-vehicles", "0"), ("--mesosim",),
    ("--device.rerouting.probability", "2"),
    ("--device.rerouting.threads", "9999"), ("--routing-threads", "9999"),
    ("--collision.action", "remove"), ("--collision.action", "x"), ("--error-log", "x"),
    ("--log", "/dev/full"), ("--log", "/nowhere/x"),
    ("--message-log", "/dev/full"), ("--fcd-output", "/dev/full"), ("--fcd-output", "/nowhere/x"),
    ("--fcd-output", "."), ("--fcd-output", "localhost:1"), ("--fcd-output", "/dev/stdout"),
    ("--tripinfo-output", "/dev/full"),
    ("--fcd-output", "pipe"), ("--netstate-dump", "/dev/full"), ("--save-state.times", "1"),
    ("--save-state.times", "x"), ("--save-state.period", "0"), ("--save-state.period", "0.1"),
    ("--summary-output", "-"),
    ("--verbose",), ("-v",), ("--print-options",), ("--duration-log.statistics",),
    ("--no-warnings", "maybe"), ("--no-step-log", "false"), ("--xml-validation", "always"),
    ("--xml-validation", "x"),
    ("--xml-validation.net", "always"), ("--language", "xx"), ("--language", "de"),
    ("--output-prefix", "/nowhere/"), ("--precision", "-1"), ("--precision", "99999"),
    ("--human-readable-time",), ("--default.action-step-length", "0"),
    ("--default.speeddev", "nan"), ("--default.carfollowmodel", "x"),
    ("--default.emergencydecel", "x"), ("--device.ssm.explicit", "other"), ("--warp", "9"),
    ("--warp=9",), ("-Z",), ("stray",), ("",), ("--",), ("\n",), ("a\nb",), ("--\x1b[31mred", "1"),
    ("--step-length",), ("--seed", "1", "--seed", "2"), ("--quit-on-end",), ("--start",),
    ("--gui",), ("--python-script", "x.py"), ("--meta.x", "1"), ("--no-internal-links",),
    ("--ignore-route-errors",), ("--route-steps", "-1"),
    ("--ignore-junction-blocker", "x"), ("--parking.maneuver",),
    ("--pedestrian.model", "jupedsim"), ("--pedestrian.model", "x"), ("--overhead-wire.solver",),
    ("--phemlight-path", "/nowhere"), ("--railsignal-moving-block",), (LONG,),
)  # fmt: skip


LISTED = 60  # of them are tried where vehicles are listed, too


def sumo_option_cases() -> Iterator[Case]:
    """Options for SUMO that end, serve, save or wait instead of simulating, and those that SUMO
    does not have."""
    for number, words in enumerate(SUMO_OPTIONS):
        told = f"{number} {' '.join(words)!r:.50}"
        driven = (
            "run",
            "good.sumocfg",
            "--ego",
            "ego",
            "--planner",
            "constant",
            "--json",
            "--time-limit",
            "3",
            "--",
            *words,
        )
        prepare = _pipe if "pipe" in words else nothing
        yield Case("sumo-option", told, driven, prepare=prepare, allowed=ANY, patience_s=DRIVING_S)
        if number < LISTED:
            yield Case(
                "sumo-option",
                f"listing, {told}",
                ("run", "good.sumocfg", "--json", "--", *words),
                prepare=prepare,
                allowed=ANY,
            )


def _pipe(folder: Path) -> None:
    os.mkfifo(folder / "pipe")


def _values(name: str, beside: tuple[str, ...], option: Option) -> Iterator[Case]:
    values = NUMBERS if option.kind in (int, float) else PATHS if option.kind is Path else TEXTS
    for value in values:
        words = (*_without(beside, option.name), option.name, value)
        yield Case(
            "option",
            f"{name} {option.name} {_shown(value)}",
            words,
            {"exp1.yaml": EXPERIMENT},
            allowed=ANY,
            patience_s=DRIVING_S,
        )


def _shown(value: str) -> str:
    return f"{value!r:.30}" if len(value) < 1000 else f"{value[:3]!r} x {len(value)}"


def _without(words: tuple[str, ...], option: str) -> tuple[str, ...]:
    """The words without this option and its value."""
    if option not in words:
        return words
    at = words.index(option)
    return (*words[:at], *words[at + 2 :])


def _counts(name: str, beside: tuple[str, ...]) -> Iterator[Case]:
    yield Case("option", f"{name} --tank", (*beside, "--tank"))
    yield Case("option", f"{name} --tank=1", (*beside, "--tank=1"))
    yield Case("option", f"{name} -x", (*beside, "-x"))
    yield Case("option", f"{name} --quiet=maybe", (*beside, "--quiet=maybe"))
    if len(beside) > 1:
        yield Case(
            "option",
            f"{name} with words too many",
            (*beside, "stray", "\x1b[31mstray", "a\nb"),
            {"exp1.yaml": EXPERIMENT},
            allowed=NOT_DRIVEN,
        )
        if name not in ("regret", "value"):  # take the built-in scenes then
            yield Case("option", f"{name} without a word", (name,), allowed=NOT_DRIVEN)
        for word in (
            "",
            "\n",
            "/dev/null",
            "/dev/zero",
            "x" * 300,
            LONG,
            "-",
            ".",
            "\x1b[31mred",
            "nowhere",
            "~",
            "*",
        ):
            yield Case("option", f"{name} of {_shown(word)}", (name, word), allowed=NOT_DRIVEN)
