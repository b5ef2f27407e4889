"""When the loop gives up on something."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator


class LoopSettings(BaseModel):
    """When the loop gives up on something."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    compute_delay_s: float = Field(
        default=0.0, ge=0, le=0.1, description="Time from the start of planning to the plan's first command"
    )
    stale_after_s: float = Field(default=0.5, gt=0, description="An observation older than this is dropped")
    lost_after_s: float = Field(default=1.0, gt=0, description="Without an observation for this long: stop")
    rest_after_s: float = Field(default=3.0, gt=0, description="Without an observation for this long: go to rest")
    rest_speed_rad_s: float = Field(default=0.5, ge=0.01, description="Speed of the return to rest")

    @model_validator(mode="after")
    def _lost_before_rest(self) -> LoopSettings:
        if self.rest_after_s < self.lost_after_s:
            raise ValueError(f"rest_after_s ({self.rest_after_s}) is less than lost_after_s ({self.lost_after_s})")
        return self
