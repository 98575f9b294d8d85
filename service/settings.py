"""Settings of the service, from the environment; docs/security.md lists them.

A secret is given as COASTARC_<NAME>, or better as COASTARC_<NAME>_FILE, the path of a file that holds it:
environments are shown by process lists and container tools, files are not.

    SettingsError(ValueError)   a variable that does not mean what it should
"""

import os
from collections.abc import Mapping
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, SecretStr, ValidationError

from core.errors import UserError, fault_lines
from core.plain_data import read_text

PREFIX = "COASTARC_"
_LISTS = ("hosts", "proxies")
_SECRETS = ("token",)


class SettingsError(UserError, ValueError):
    """A variable that does not mean what it should."""


class Settings(BaseModel):
    """Settings of an operator."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    #: `required` asks for a token on loopback as well.
    auth: Literal["auto", "required"] = "auto"
    #: Names under which clients reach the service, besides those of loopback.
    hosts: tuple[str, ...] = ()
    #: Addresses of proxies whose forwarded headers are believed.
    proxies: tuple[IPv4Network | IPv6Network, ...] = ()
    #: Requests of one token or address [1/s], and how many it may send at once.
    requests_per_second: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] = 100.0
    request_burst: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    #: The same for a worker, which reports every job.
    worker_requests_per_second: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] = 1000.0
    worker_request_burst: Annotated[int, Field(ge=1, le=1_000_000)] = 5000
    #: Event streams that one token or address may have open.
    streams_per_client: Annotated[int, Field(ge=1, le=10_000)] = 16
    #: The token that commands send to a coordinator.
    token: SecretStr | None = None

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> Self:
        """Return the settings that the variables name; one that is empty counts as absent."""
        variables = os.environ if environment is None else environment
        found: dict[str, Any] = {}
        for field in cls.model_fields:
            value = _value_of(field, variables)
            if value:
                found[field] = [part.strip() for part in value.split(",")] if field in _LISTS else value
        try:
            return cls(**found)
        except ValidationError as error:
            faults = [
                {**fault, "loc": (variable_of(str(fault["loc"][0])), *fault["loc"][1:])}
                for fault in error.errors()
            ]
            raise SettingsError("\n".join(fault_lines("environment", faults))) from None


def variable_of(field: str) -> str:
    """Return the variable that a setting is read from."""
    return PREFIX + field.upper()


def _value_of(field: str, variables: Mapping[str, str]) -> str:
    name = variable_of(field)
    plain = variables.get(name, "")
    path = variables.get(f"{name}_FILE", "") if field in _SECRETS else ""
    if plain and path:
        raise SettingsError(f"{name}: expected itself or {name}_FILE, got both")
    return _read(f"{name}_FILE", path) if path else plain


def _read(name: str, path: str) -> str:
    try:
        value = read_text(Path(path)).strip()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingsError(f"{name}: expected a file to read, got {path}: {reason}") from None
    if not value:
        raise SettingsError(f"{name}: expected a file with a secret, got {path}, which is empty")
    return value
