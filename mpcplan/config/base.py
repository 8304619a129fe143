"""What every parameter and every group of parameters has."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

CLASS = r"([^\W\d]\w*(?:\.[^\W\d]\w*)*):([^\W\d]\w*)"
ClassName = Annotated[str, Field(pattern=rf"^{CLASS}$")]
"""The name of a class that is not ours, 'package.module:Class'."""


def par(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """A parameter: its default, unit, meaning and limits (pydantic's gt, ge, lt, le)."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


class Section(BaseModel):
    """A group of parameters; unknown keys are refused and values cannot change."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
