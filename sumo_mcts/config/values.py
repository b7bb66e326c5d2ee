"""Types of values in scenario files, each with its bounds."""

from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

MOST_SEED = 2**31 - 1  # SUMO's largest
MOST_OF_OPTION = 1e9  # a number among SUMO's options
MOST_ID = 500  # characters


def _id(text: str) -> str:
    """The text, if SUMO could take it for an id. Raises ValueError."""
    if not 0 < len(text) <= MOST_ID or any(c.isspace() or not c.isprintable() for c in text):
        raise ValueError(
            f"has to be a text of 1 to {MOST_ID} characters without spaces, line breaks and "
            "control characters"
        )
    return text


# Every number has bounds: beyond them memory, time or arithmetic gives out. True and "1" are no
# numbers.
Float = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Int = Annotated[int, Field(strict=True)]
Positive = Annotated[Float, Field(ge=0.01, le=1_000_000)]
NonNegative = Annotated[Float, Field(ge=0, le=1_000_000)]
Share = Annotated[Float, Field(ge=0, le=1)]
Part = Annotated[Float, Field(ge=0, le=1000)]
Metres = Annotated[Float, Field(ge=0, le=1_000_000)]
Speed = Annotated[Float, Field(ge=0, le=200)]
TopSpeed = Annotated[Float, Field(ge=0.1, le=200)]
Acceleration = Annotated[Float, Field(ge=0.01, le=100)]
Jerk = Annotated[Float, Field(ge=0.01, le=1000)]
Headway = Annotated[Float, Field(ge=0.01, le=60)]
Gap = Annotated[Float, Field(ge=0.01, le=100)]
StepTime = Annotated[Float, Field(ge=0.01, le=10)]
Delay = Annotated[Float, Field(ge=0, le=60)]
Milliseconds = Annotated[Float, Field(ge=0.01, le=60_000)]
Action = Annotated[Float, Field(ge=-20, le=20)]
Actions = Annotated[tuple[Action, ...], Field(max_length=32)]
LaneNumber = Annotated[Int, Field(ge=0, le=100)]
Count = Annotated[Int, Field(ge=0, le=1_000_000)]
CrowdSize = Annotated[Int, Field(ge=0, le=500)]
Flag = Annotated[bool, Field(strict=True)]
Id = Annotated[str, AfterValidator(_id)]
FileName = Annotated[str, Field(min_length=1, max_length=4000)]
FileNames = Annotated[tuple[FileName, ...], Field(max_length=1000)]
Edges = Annotated[tuple[Id, ...], Field(min_length=1, max_length=2000)]


def _scalar(value: object) -> object:
    if not isinstance(value, str | int | float | bool):
        raise ValueError("has to be a text, a number, true or false")
    if isinstance(value, int | float) and not abs(value) <= MOST_OF_OPTION:
        raise ValueError(f"has to be a number from -{MOST_OF_OPTION:.0f} to {MOST_OF_OPTION:.0f}")
    return value


_SumoInt = Annotated[int, Field(strict=True, ge=-MOST_OF_OPTION, le=MOST_OF_OPTION)]
_SumoFloat = Annotated[float, Field(strict=True, ge=-MOST_OF_OPTION, le=MOST_OF_OPTION)]
SumoValue = Annotated[str | _SumoInt | _SumoFloat | bool, BeforeValidator(_scalar)]
