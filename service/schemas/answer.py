"""What all answers of the API share: their base, refusals, and one thing looked at.

Units stand in the names; epochs are TDB calendar text, `created_at` is UTC.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict

CampaignState = Literal["active", "paused", "done", "cancelled"]


class Answer(BaseModel):
    """A body that the service sends."""

    # Built when it is first used: a list needs few of all models.
    model_config = ConfigDict(defer_build=True, from_attributes=True, ser_json_inf_nan="null")


class Fault(Answer):
    """A refusal as `application/problem+json` (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    #: What a program reads where the status leaves open what was wrong, as "stale_attempt".
    code: str | None = None


class Health(Answer):
    """Whether the service is alive, or ready, and the reason if not."""

    status: Literal["ok", "unavailable"]
    checks: dict[str, str]


class Check(BaseModel):
    """One thing looked at."""

    name: str
    state: Literal["ok", "warning", "failed"]
    found: str
    advice: str = ""
