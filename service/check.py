"""One thing looked at, and what to do about it: what doctor, `db check` and `benchmark check` show."""

from typing import Literal

from pydantic import BaseModel


class Check(BaseModel):
    """One thing looked at."""

    name: str
    state: Literal["ok", "warning", "failed"]
    found: str
    advice: str = ""
