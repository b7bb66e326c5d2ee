"""What all sections of a scenario file have in common."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A mapping of known keys: others are refused, defaults are checked, nothing changes later."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
