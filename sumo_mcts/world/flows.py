"""Flows in SUMO's files with so many vehicles at once that no step of SUMO is ever over."""

import re
from pathlib import Path

from sumo_mcts import files

MOST_NUMBER = 1_000_000  # vehicles of a flow
MOST_RATE = 1000.0  # of them a second
WITHIN = 1 << 24  # bytes of a file that are looked through

_FLOW = re.compile(rb"<(?:flow|personFlow|containerFlow)\b([^>]*)>")
_ATTRIBUTE = re.compile(rb"""([A-Za-z]+)\s*=\s*["']([^"']*)["']""")
_EXPONENTIAL = re.compile(r"\s*exp\(([^)]*)\)?\s*")


def problem(path: Path) -> str:
    """What is wrong with the first flow of a file that no simulation can take, in a few words; "":
    nothing. Raises OSError."""
    for flow in _FLOW.finditer(files.beginning(path, WITHIN)):
        attributes = {
            key.decode(): value.decode(errors="replace")
            for key, value in _ATTRIBUTE.findall(flow[1])
        }
        why = _endless(attributes)
        if why:
            return f"flow {attributes.get('id', '')}: {why}"
    return ""


def _endless(attributes: dict[str, str]) -> str:
    """Why a flow has too many vehicles; "": it has not."""
    number = _number(attributes.get("number", ""))
    rate = _EXPONENTIAL.fullmatch(attributes.get("period", ""))
    if number is not None and not number <= MOST_NUMBER:
        return f"number: has to be at most {MOST_NUMBER}, got {attributes['number']}"
    if rate is not None and _number(rate[1]) is not None and not 0.0 < float(rate[1]) <= MOST_RATE:
        return (
            f"period: has to be exp of at most {MOST_RATE:g} vehicles a second, got "
            f"{attributes['period']}"
        )
    return ""


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:  # SUMO itself says so
        return None
