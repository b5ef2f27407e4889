"""A sweep file: varied settings, design, recordings and tabulated metrics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from experiments.aggregate import METRICS
from experiments.sweep.names import check_name, check_settings, check_value, is_number, setting_fields
from gazempc.errors import shown, suggest
from gazempc.specfiles import explain

Design = Literal["grid", "random", "sobol", "optuna"]
Direction = Literal["maximize", "minimize"]

# Labels for the axes of figures, besides the varied settings.
LABELS = ("case", "group", "controller")
_MORE_IS_BETTER = ("eye_contact_2p6", "eye_contact_4", "eye_contact_9", "sparc", "ldlj")


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Range(_Strict):
    """All values between two ends, both included."""

    low: float
    high: float
    log: bool = Field(default=False, description="Uniform in the logarithm")
    integer: bool = Field(default=False, description="Integers only")


def _check_base(base: dict[str, Any]) -> dict[str, Any]:
    checked, problems = check_settings(base)
    if problems:
        raise ValueError("\n".join(problems))
    return checked


def _check_vary(vary: dict[str, Any]) -> dict[str, Any]:
    problems: list[str] = []
    checked: dict[str, Any] = {}
    for name, entry in vary.items():
        if wrong := check_name(name):
            problems.append(f"{name}: {wrong}")
        elif isinstance(entry, list):
            if not entry:
                problems.append(f"{name}: an empty list of values")
            results = [check_value(name, value) for value in entry]
            problems += [f"{name}: {problem}" for _, problem in results if problem]
            # Without duplicates.
            checked[name] = tuple(dict.fromkeys(value for value, problem in results if not problem))
        elif isinstance(entry, dict):
            try:
                checked[name] = Range.model_validate(entry)
            except ValidationError as error:
                problems += explain(error, name, Range).splitlines()
            else:
                problems += [f"{name}: {problem}" for problem in _range_problems(name, checked[name])]
        else:
            problems.append(f"{name}: expected a list of values or {{low, high}} (given: {shown(entry)})")
    if problems:
        raise ValueError("\n".join(problems))
    return checked


def _range_problems(name: str, ends: Range) -> Iterable[str]:
    field = setting_fields()[name]
    if not is_number(field):
        yield "is not numeric; give a list of values"
        return
    for end in ("low", "high"):
        value = getattr(ends, end)
        if problem := check_value(name, value)[1]:
            yield f"{end}: {problem}"
        if (ends.integer or field.annotation is int) and value != round(value):
            yield f"{end}: not an integer (given: {value})"
    if not ends.low < ends.high:
        yield f"low ({ends.low:g}) must be less than high ({ends.high:g})"
    if ends.log and ends.low <= 0:
        yield f"low must be more than 0 if log is true (given: {ends.low:g})"


def _check_metric(name: str) -> str:
    if name not in METRICS:
        raise ValueError(f"unknown metric {name!r}; {suggest(name, METRICS)}")
    return name


def _one_or_many(value: Any) -> Any:
    return [value] if isinstance(value, list) and value and all(isinstance(part, str) for part in value) else value


Base = Annotated[dict[str, Any], AfterValidator(_check_base)]
Vary = Annotated[dict[str, Any], AfterValidator(_check_vary)]
# Number of points of a random, sobol or optuna design.
Count = Annotated[int | None, Field(ge=1, le=100_000)]
Metric = Annotated[str, AfterValidator(_check_metric)]


class Objective(_Strict):
    """An objective of a tuning."""

    metric: Metric
    direction: Direction


class Figures(_Strict):
    """Figures to draw; each kind once or several times. x and by are settings that vary, or case, group, controller."""

    response: Annotated[tuple[tuple[str, Metric, str], ...], BeforeValidator(_one_or_many)] = Field(
        default=(), description="[x, metric, by]: mean of a metric over x, one line per value of by"
    )
    pareto: Annotated[tuple[tuple[Metric, Metric, str], ...], BeforeValidator(_one_or_many)] = Field(
        default=(), description="[x metric, y metric, by]: all points, the front of each value of by as a line"
    )


class Case(_Strict):
    """A named part of a sweep; unset fields have the values of the sweep."""

    name: str = Field(min_length=1)
    base: Base = {}
    vary: Vary = {}
    design: Design | None = None
    n: Count = None


class SweepSpec(_Strict):
    """A sweep file."""

    name: str = Field(pattern=r"^[\w-]+$", description="Short name, also of the output folder")
    question: str = Field(default="", description="Question that the sweep answers")
    recordings: tuple[str, ...] = Field(default=("synthetic",), min_length=1)
    base: Base = {}
    vary: Vary = {}
    design: Design = "grid"
    n: Count = None
    seed: int = Field(default=0, ge=0, description="Seed of the design; the sensor's is the setting `seed`")
    objectives: tuple[Objective, ...] = Field(
        default=(
            Objective(metric="eye_contact_2p6", direction="maximize"),
            Objective(metric="rms_acceleration_rad_s2", direction="minimize"),
        ),
        min_length=1,
    )
    metrics: tuple[Metric, ...] = Field(
        default=("gaze_error_rms_deg", "gaze_error_p95_deg", "eye_contact_2p6", "rms_acceleration_rad_s2"), min_length=1
    )
    figures: Figures = Figures()
    cases: tuple[Case, ...] = ()

    def all_cases(self) -> tuple[Case, ...]:
        """Complete cases, with the defaults of the sweep; the sweep itself if it has no cases."""
        return tuple(
            Case.model_construct(
                name=case.name,
                base={**self.base, **case.base},
                vary={**{name: entry for name, entry in self.vary.items() if name not in case.base}, **case.vary},
                design=case.design or self.design,
                n=case.n or self.n,
            )
            for case in self.cases or (Case.model_construct(name=self.name),)
        )

    def varied(self) -> tuple[str, ...]:
        """Names of the settings that vary in any case."""
        return tuple(dict.fromkeys(name for case in self.all_cases() for name in case.vary))

    @model_validator(mode="after")
    def _check_relations(self) -> Self:
        problems = list(self._relations())
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _relations(self) -> Iterator[str]:
        if not self.cases and not self.vary:
            yield "vary: no setting varies; give vary or cases"
        names = [case.name for case in self.cases]
        yield from (f"cases: duplicate name {name!r}" for name in {n for n in names if names.count(n) > 1})
        parts = [("", self.base, self.vary), *((f"cases.{i}.", c.base, c.vary) for i, c in enumerate(self.cases))]
        for where, base, vary in parts:
            yield from (f"{where}vary: {name} is in base too" for name in sorted({*base} & {*vary}))
        for i, case in enumerate(self.all_cases()):
            where = f"cases.{i}." if self.cases else ""
            if "controller" not in {**case.base, **case.vary}:
                yield f"{where}base: no controller; give it in base or in vary"
            for name in (n for n, entry in case.vary.items() if case.design == "grid" and isinstance(entry, Range)):
                yield f"{where}vary: {name}: a grid needs a list of values (designs with ranges: random, sobol, optuna)"
            if case.design != "grid" and case.n is None:
                yield f"{where}n: missing; design {case.design} needs the number of points"
            if case.design != "grid" and not case.vary:
                yield f"{where}vary: no setting varies; design {case.design} needs a setting to vary"
        varied = (*LABELS, *self.varied())
        drawn = {
            "response": [name for x, _, by in self.figures.response for name in (x, by)],
            "pareto": [by for _, _, by in self.figures.pareto],
        }
        for kind, names in drawn.items():
            for name in (n for n in names if n not in varied):
                yield f"figures.{kind}: {name} does not vary; {suggest(name, varied)}"


def direction_of(metric: str) -> Direction:
    """Direction of improvement of a metric."""
    return "maximize" if metric in _MORE_IS_BETTER else "minimize"
