"""P_k: a transfer with k outages, as data that is validated and hashed.

Input: TOML, JSON or keyword arguments.  Output: a frozen `Problem` in public units (km, km/s, kg, days, TDB
epochs); everything else in core is a function of it.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    StrictInt,
    ValidationError,
    model_serializer,
    model_validator,
)

from core.constants import G0, GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN, KERNEL_MD5, KERNEL_SPAN, SECONDS_PER_DAY
from core.epochs import Epoch, calendar_epoch, seconds_past_j2000
from core.errors import UserError, fault_lines
from core.plain_data import (
    canonical,
    canonical_hash,
    content_hash,
    file_digest,
    kernel_file,
    read_table_file,
    read_toml,
)
from core.ranges import slips
from core.world import WorldFields, absent_if_usual, world_of

SCHEMA_VERSION = 1

#: Longest outage of a problem whose bounds do not say otherwise [days], and of any.
LONGEST_OUTAGE_DAYS, MOST_OUTAGE_DAYS = 20.0, 1000.0

#: The target is made over this span past departure at least, and with it so far beyond both ends [days].
LEAST_SPAN_DAYS, KERNEL_MARGIN_DAYS = 200.0, 45.0

# What a problem means besides its own fields.
_WORLD = {"kernel": KERNEL_MD5, "gm": [GM_EARTH, GM_MOON, GM_SUN, GM_JUPITER], "g0": G0}


class ProblemError(UserError, ValueError):
    """An invalid problem: the message names each field, the expected and the given value."""


Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]


class _Strict(BaseModel):
    # Built on first use: listing solutions does not need problems.
    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", allow_inf_nan=False)


class _Grown(_Strict):
    """Data with fields that came later: at their default they are absent, so that hashes stay."""

    #: The fields that came later.
    later: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _without_later(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = dump(self)
        usual = {name: type(self).model_fields[name].default for name in self.later}
        return {
            name: value
            for name, value in fields.items()
            if name not in usual or getattr(self, name) != usual[name]
        }


class Spacecraft(_Strict):
    """Mass and propulsion."""

    #: Mass at the start of the spiral [kg].
    wet_mass_kg: Positive
    #: Mass without propellant [kg].
    dry_mass_kg: Positive
    #: Thrust at throttle 1 [N].
    max_thrust_n: Positive
    #: Specific impulse [s], with g0 = 9.806 m/s^2.
    isp_s: Positive

    @model_validator(mode="after")
    def _masses_ordered(self) -> Self:
        if self.dry_mass_kg >= self.wet_mass_kg:
            raise ValueError(
                f"expected dry_mass_kg < wet_mass_kg, got {self.dry_mass_kg} >= {self.wet_mass_kg}"
            )
        return self


class StateDeparture(_Strict):
    """A transfer that starts from a known state relative to the centre of the world."""

    kind: Literal["state"] = "state"
    #: TDB epoch t0 of the state.
    epoch: Epoch
    #: J2000 position [km].
    position_km: Vector
    #: J2000 velocity [km/s].
    velocity_km_s: Vector
    #: Mass m(t0) [kg].
    mass_kg: Positive


class SpiralDeparture(_Strict):
    """A transfer that starts at the end of a spiral: full thrust along the velocity from a parking orbit."""

    kind: Literal["spiral"]
    #: TDB epoch at perigee of the parking orbit.
    epoch: Epoch
    #: Radii of the parking orbit [km].
    perigee_radius_km: Positive
    apogee_radius_km: Positive
    #: Orientation of the parking orbit to the J2000 equator [deg].
    inclination_deg: Annotated[float, Field(ge=0, le=180)]
    raan_deg: float
    argument_of_perigee_deg: float
    #: Thrust for this long [days] ...
    duration_days: Annotated[float, Field(gt=0, le=1000)] | None = None
    #: ... or until this Jacobi value of the instantaneous Earth-Moon system is reached from above.
    jacobi: float | None = None

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if (self.duration_days is None) == (self.jacobi is None):
            raise ValueError("expected exactly one of duration_days and jacobi")
        if self.apogee_radius_km < self.perigee_radius_km:
            raise ValueError(
                f"expected apogee_radius_km >= perigee_radius_km, got "
                f"{self.apogee_radius_km} < {self.perigee_radius_km}"
            )
        return self


class NrhoTarget(_Strict):
    """The near-rectilinear halo orbit that coastarc generates: ballistic in its own N-body model."""

    kind: Literal["nrho"] = "nrho"
    #: Period of the CR3BP orbit that starts the correction [days].
    period_days: Annotated[float, Field(gt=6.0, lt=8.5)] = 6.5623
    #: TDB epoch near which a perilune falls.
    perilune_epoch: Epoch = "2026-04-30T00:00:00"


class SpkTarget(_Strict):
    """Any body or spacecraft of an SPK kernel, about whatever centre SPICE can follow to DE440's bodies."""

    kind: Literal["spk"]
    #: In a file of a problem or a campaign relative to the folder of that file.
    path: Path
    naif_id: StrictInt
    #: Digest of the file's content, blake2b-128; filled in by `problem_from`, and from then on required.
    digest: Annotated[str, Field(pattern="^[0-9a-f]{32}$")] | None = None

    def with_file_read(self) -> Self:
        """Return this target with the absolute path of its file and the digest of the content.

        Raises
        ------
        ValueError
            When the file cannot be read, or has another digest than the target.
        """
        path, digest = kernel_file(self.path, self.digest)
        return self.model_copy(update={"path": path, "digest": digest})

    def digest_now(self) -> str:
        """Return the digest of the content that the file has by now."""
        return file_digest(self.path)


Interval = tuple[float, float]


class Bounds(_Grown):
    """The box of the decision vector, in which guesses are drawn; the dry mass bounds solutions further."""

    #: Time T_s under the control of segments [days]; a realization at n gets the share (N-n)/N.
    shooting_days: Interval = (1e-3, 90.0)
    #: Coasts T_i and T_f [days].
    initial_coast_days: Interval = (0.0, 30.0)
    final_coast_days: Interval = (0.0, 30.0)
    throttle: Interval = (0.0, 1.0)
    #: Least final mass [kg]; no solution has less than the dry mass either.
    min_final_mass_kg: Positive = 1.0
    #: Longest outage that may be asked for [days]; the target is known so much longer.
    longest_outage_days: Annotated[float, Field(gt=0, le=MOST_OUTAGE_DAYS)] = LONGEST_OUTAGE_DAYS

    later: ClassVar[frozenset[str]] = frozenset({"longest_outage_days"})

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name in ("shooting_days", "initial_coast_days", "final_coast_days", "throttle"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name}: expected lower < upper, got {low} >= {high}")
            if low < 0:
                raise ValueError(f"{name}: expected a lower bound >= 0, got {low}")
        if self.shooting_days[0] <= 0:
            raise ValueError(f"shooting_days: expected a lower bound > 0, got {self.shooting_days[0]}")
        if self.throttle[1] > 1:
            raise ValueError(f"throttle: expected an upper bound <= 1, got {self.throttle[1]}")
        return self


class Outage(_Strict):
    """A time without thrust that begins with a segment of the reference."""

    #: Segment of the reference at whose start the thruster stops, from 1.
    segment: Annotated[StrictInt, Field(ge=1)]
    #: How long it stays off [days].
    duration_days: Annotated[float, Field(gt=0, le=MOST_OUTAGE_DAYS)]


def _in_order(outages: Iterable[Outage]) -> tuple[Outage, ...]:
    """Return outages in the order in which x lists the realizations."""
    return tuple(sorted(outages, key=lambda outage: (outage.segment, outage.duration_days)))


def _require_possible(outages: tuple[Outage, ...], n_segments: int, longest_days: float) -> None:
    """Raise ValueError where a problem cannot have ordered outages together."""
    last = n_segments - 1
    for outage in outages:
        if outage.duration_days > longest_days:
            raise ValueError(
                f"outages: expected at most {longest_days:g} days, got {outage.duration_days:g}; "
                f"set bounds.longest_outage_days"
            )
        if outage.segment > last:
            raise ValueError(
                f"outages: expected a segment in 1..{last} (one must remain after the missed one), "
                f"got {outage.segment}"
            )
    for first, second in itertools.pairwise(outages):
        if first == second:
            raise ValueError(
                f"outages: expected different outages, got segment {first.segment} with "
                f"{first.duration_days} days twice"
            )


class Problem(_Grown):
    """P_k: one reference trajectory and k realizations, one per outage."""

    later: ClassVar[frozenset[str]] = frozenset({"world"})

    spacecraft: Spacecraft
    departure: Annotated[StateDeparture | SpiralDeparture, Field(discriminator="kind")]
    target: Annotated[NrhoTarget | SpkTarget, Field(discriminator="kind")] = NrhoTarget()
    bounds: Bounds = Bounds()
    #: Number N of segments of the reference.
    n_segments: Annotated[StrictInt, Field(ge=2, le=2000)] = 50
    #: Control of a segment: throttle, in-plane and out-of-plane angle (J2000 azimuth and elevation).
    control: Literal["spherical"] = "spherical"
    #: Segments of a realization at n: N - n of them ("adaptive") or N ("uniform").
    segmentation: Literal["adaptive", "uniform"] = "adaptive"
    #: The k outages, kept in the order (segment, duration) in which x lists the realizations.
    outages: Annotated[tuple[Outage, ...], AfterValidator(_in_order)] = ()
    #: Which body is the origin, and which pull; None for the Earth with Moon, Sun and Jupiter.
    world: Annotated[WorldFields | None, AfterValidator(absent_if_usual)] = None

    @model_validator(mode="after")
    def _outages_possible(self) -> Self:
        _require_possible(self.outages, self.n_segments, self.bounds.longest_outage_days)
        return self

    @model_validator(mode="after")
    def _ends_in_world(self) -> Self:
        if self.world is not None:
            alone = "which is made in the usual world of the Earth alone"
            if isinstance(self.target, NrhoTarget):
                raise ValueError(
                    f"target: expected an object of a kernel, got an NRHO, {alone}; "
                    f"leave out world, or export the orbit and give its file"
                )
            if isinstance(self.departure, SpiralDeparture):
                raise ValueError(
                    f"departure: expected a state, got a spiral, {alone}; "
                    f"leave out world, or give its end as a state"
                )
        return self

    @model_validator(mode="after")
    def _masses_possible(self) -> Self:
        wet, least = self.spacecraft.wet_mass_kg, self.bounds.min_final_mass_kg
        start, name = wet, "spacecraft.wet_mass_kg"
        if isinstance(self.departure, StateDeparture):
            start, name = self.departure.mass_kg, "departure.mass_kg"
        if start > wet:
            raise ValueError(f"departure.mass_kg: expected at most wet_mass_kg {wet}, got {start}")
        if least >= start:
            raise ValueError(f"bounds.min_final_mass_kg: expected less than {name} = {start}, got {least}")
        return self

    @model_validator(mode="after")
    def _inside_kernels(self) -> Self:
        departure = seconds_past_j2000(self.departure.epoch)
        latest = departure + max(self.latest_arrival_days, LEAST_SPAN_DAYS) * SECONDS_PER_DAY
        for name, et, margin in (
            ("departure", departure, -KERNEL_MARGIN_DAYS),
            ("latest arrival", latest, KERNEL_MARGIN_DAYS),
        ):
            if not KERNEL_SPAN[0] < et + margin * SECONDS_PER_DAY < KERNEL_SPAN[1]:
                raise ValueError(
                    f"departure.epoch: expected the {name} at least {KERNEL_MARGIN_DAYS:g} days inside the "
                    f"kernel DE440, 1549-12-31 to 2650-01-25, got {calendar_epoch(et)}"
                )
        return self

    @property
    def k(self) -> int:
        """Number of outages."""
        return len(self.outages)

    @property
    def least_final_mass_kg(self) -> float:
        """Least mass with which any trajectory may arrive: it has to carry what is no propellant [kg]."""
        return max(self.spacecraft.dry_mass_kg, self.bounds.min_final_mass_kg)

    @property
    def latest_arrival_days(self) -> float:
        """Latest arrival under any outages, counted from the departure epoch [days].

        All P_k of a family fly to one target, so its span must not depend on their outages.
        """
        bounds = self.bounds
        coasts = 2.0 * bounds.initial_coast_days[1] + bounds.final_coast_days[1]
        spiral = getattr(self.departure, "duration_days", None) or 0.0
        return spiral + coasts + bounds.shooting_days[1] + bounds.longest_outage_days

    def with_outages(self, outages: Iterable[tuple[int, float]]) -> "Problem":
        """Return this problem with other outages, each given as (segment, duration_days)."""
        listed = [{"segment": segment, "duration_days": duration} for segment, duration in outages]
        return problem_from(self.model_dump(mode="json") | {"outages": listed})

    def with_cases(self, cases: Iterable[Iterable[tuple[int, float]]]) -> "list[Problem]":
        """Return this problem with the outages of each case; what the cases share is validated once.

        All but their outages are the same objects, by which `hashes_of` knows a family.
        """
        members: list[Problem] = []
        for case in cases:
            listed = list(case)
            members.append(members[0]._beside(listed) if members else self.with_outages(listed))
        return members

    def _beside(self, case: list[tuple[int, float]]) -> "Problem":
        """Return a validated problem with other outages, of which alone something may be wrong."""
        try:
            outages = _in_order(Outage(segment=segment, duration_days=days) for segment, days in case)
            _require_possible(outages, self.n_segments, self.bounds.longest_outage_days)
            return self.model_copy(update={"outages": outages})
        except ValueError:
            # Reports errors as those of a problem.
            return self.with_outages(case)

    @property
    def hash(self) -> str:
        """Identity of the problem: its definition, its kernels and its constants (32 hex digits)."""
        return content_hash(self._identity())

    def _identity(self) -> dict[str, Any]:
        return (
            {"schema": SCHEMA_VERSION, "target_file": self._target_digest()}
            | _WORLD
            | ({"gm": world_of(self).all_gm_km3_s2} if self.world else {})
            | self.model_dump(mode="json", exclude={"target": {"path", "digest"}, "world": {"kernel"}})
        )

    @property
    def family(self) -> str:
        """Identity of the reference problem: equal for all P_k that differ in outages alone."""
        return self.model_copy(update={"outages": ()}).hash

    def _target_digest(self) -> str:
        return (self.target.digest or "") if isinstance(self.target, SpkTarget) else ""


def require_departure_mass(problem: Problem, mass_kg: float) -> None:
    """Raise ProblemError unless a departure with a mass [kg] leaves propellant to burn.

    No check of the fields themselves: problems that were accepted before it are still read.
    """
    least = problem.least_final_mass_kg
    if not mass_kg > least:
        is_dry = least == problem.spacecraft.dry_mass_kg
        name = "spacecraft.dry_mass_kg" if is_dry else "bounds.min_final_mass_kg"
        raise ProblemError(
            f"departure: expected a mass above {name} = {least:g} kg, got {mass_kg:g} kg; "
            f"correct one of them: no propellant would be left to burn"
        )


def hashes_of(problems: Sequence[Problem]) -> list[str]:
    """Return the hash of each problem, several times quicker than one by one for those of `with_cases`."""
    if not problems:
        return []
    first = problems[0]
    shared = canonical(first._identity())
    return [
        canonical_hash(shared | {"outages": canonical(_fields_of_outages(problem))})
        if _is_of_one_family(first, problem)
        else problem.hash
        for problem in problems
    ]


def definitions_of(problems: Sequence[Problem]) -> list[dict[str, Any]]:
    """Return each problem as plain data with every field written out; what they share is the same data."""
    if not problems:
        return []
    first = problems[0]
    shared = first.model_dump(mode="json")
    return [
        shared | {"outages": _fields_of_outages(problem)}
        if _is_of_one_family(first, problem)
        else problem.model_dump(mode="json")
        for problem in problems
    ]


def _is_of_one_family(first: Problem, other: Problem) -> bool:
    """Return whether all but the outages are identical objects: equal zeros may differ in sign."""
    return all(getattr(first, name) is getattr(other, name) for name in _SHARED)


_SHARED = tuple(name for name in Problem.model_fields if name != "outages")


def _fields_of_outages(problem: Problem) -> list[dict[str, Any]]:
    return [{"segment": one.segment, "duration_days": one.duration_days} for one in problem.outages]


def presets() -> list[str]:
    """Return the names of the problems that coastarc ships."""
    return sorted(entry.name.removesuffix(".toml") for entry in _preset_folder().iterdir())


def load_problem(path_or_preset: str | Path) -> Problem:
    """Return the problem of a preset, or of a TOML or JSON file with the same fields.

    Parameters
    ----------
    path_or_preset : str or Path
        A name from `presets()`, or a .toml or .json file; of a campaign file the table `problem` is read.

    Raises
    ------
    ProblemError
        When a field is unknown, missing or impossible, or the file cannot be read.
    """
    if str(path_or_preset) in presets():
        return problem_from({"preset": str(path_or_preset)})
    path = Path(path_or_preset)
    try:
        table = read_table_file(path)
    except (OSError, ValueError) as error:
        names, reason = ", ".join(presets()), getattr(error, "strerror", None) or error
        raise ProblemError(
            f"problem: expected a preset ({names}) or a readable file, got {path}: {reason}"
        ) from error
    fields = table.get("problem", table) if isinstance(table, dict) else table
    problem = problem_from(beside(fields, path.parent))
    require_physical(problem)
    return problem


def require_physical(problem: Problem, name: str = "problem") -> None:
    """Raise ProblemError for values implausible near the Earth, which are probably slips of a unit.

    Definitions stored in an archive are read by `problem_from` alone, so that none becomes unreadable.

    Parameters
    ----------
    problem : Problem
        The problem as given by the user.
    name : str
        What it is called in messages.

    Raises
    ------
    ProblemError
        One line per field: the expected and the given value, and the likely slip.
    """
    if faults := slips(problem):
        raise ProblemError("\n".join(f"{name}.{fault}" for fault in faults))


def beside(fields: Any, folder: Path) -> Any:
    """Return the fields of a problem, relative paths of its target and its world resolved in a folder."""
    if not isinstance(fields, Mapping):
        return fields
    resolved = dict(fields)
    for name, key in (("target", "path"), ("world", "kernel")):
        table = fields.get(name)
        if not isinstance(table, Mapping) or not isinstance(table.get(key), str):
            continue
        try:
            resolved[name] = {**table, key: str((folder / table[key]).resolve())}
        except (OSError, ValueError):
            continue  # The check of the field says what is wrong with it.
    return resolved


def problem_from(fields: Any) -> Problem:
    """Return the problem that plain data describes; `preset` gives the fields left out.

    The file of a target is read here: what is valid does not depend on the disk.

    Raises
    ------
    ProblemError
        One line per field that is unknown, missing or impossible, or the file of the target.
    """
    if not isinstance(fields, Mapping):
        raise ProblemError(f"problem: expected a table of fields, got {type(fields).__name__}")
    given = dict(fields)
    try:
        problem = Problem.model_validate(_merge(_preset(given.pop("preset", None)), given))
    except ValidationError as error:
        raise ProblemError(validation_message("problem", error, Problem)) from error
    return _with_files_read(problem)


def _with_files_read(problem: Problem) -> Problem:
    """Return a problem whose target and world name the content of their files, if they have any."""
    read: dict[str, Any] = {}
    name = "target"
    try:
        if isinstance(problem.target, SpkTarget):
            read["target"] = problem.target.with_file_read()
        name = "world.kernel"
        if problem.world is not None and problem.world.kernel is not None:
            kernel, digest = kernel_file(problem.world.kernel, problem.world.digest)
            read["world"] = problem.world.model_copy(update={"kernel": kernel, "digest": digest})
    except ValueError as error:
        raise ProblemError(f"problem.{name}: {error}") from error
    return problem.model_copy(update=read)


def validation_message(thing: str, error: ValidationError, model: type[BaseModel]) -> str:
    """Return one line per fault in the data of a model: `<thing>.<field>: <expected>, got <value>`."""
    return "\n".join(fault_lines(thing, error.errors(include_url=False), model))


def _preset_folder() -> Any:
    return files("core") / "presets"


def _preset(name: str | None) -> dict[str, Any]:
    if name is None:
        return {}
    if name not in presets():
        raise ProblemError(f"problem.preset: expected one of {', '.join(presets())}, got {name!r}")
    return read_toml((_preset_folder() / f"{name}.toml").read_text(encoding="utf-8"))


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge changes into base; a table of another kind replaces the old one completely."""
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping) and _same_kind(value, old):
            merged[key] = _merge(old, value)
        else:
            merged[key] = value
    return merged


def _same_kind(changes: Mapping[str, Any], base: Mapping[str, Any]) -> bool:
    return bool(changes.get("kind", base.get("kind")) == base.get("kind"))
