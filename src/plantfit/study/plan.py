"""What a study is to do: methods, runs, budget and seed, cut into fixed chunks of runs."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from plantfit.errors import SearchError
from plantfit.optimize import registry
from plantfit.study.store.codec import plain

MOST_RUNS = 1_000_000  # their tasks are rows of the store and stand in memory
LIMIT = 2**31  # what `minimise` counts to
SMALLEST_CHUNK, LARGEST_CHUNK = 5, 100
# multiple shooting has found the basin: one descent from there, unless a method is named
AFTER_SHOOTING = ("least_squares", {"agree": 1})
TASKS_OF_METHOD = 10  # enough to keep several workers busy to the end


@dataclass(frozen=True)
class Plan:
    """Every method gets `runs` seeded runs of `budget` evaluations each.

    `settings` maps a method to its settings. `chunk` is the number of runs in one task, chosen from
    `runs` if None; it is part of the plan, so that results do not depend on how many workers share
    the tasks. `gradient_charge` and `jacobian_charge`, in evaluations, are those of the objective
    that the study begins with, kept so that every worker and every later sitting charges the same.
    Raises SearchError for anything that could not run.
    """

    name: str
    methods: tuple[str, ...] = ("auto",)
    runs: int = 20
    budget: int = 5000
    seed: int = 1
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    chunk: int | None = None
    gradient_charge: float | None = None
    jacobian_charge: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise SearchError(f"The study has the name {self.name!r}; give it a name of at least one letter.")
        for key, least in (("runs", 1), ("budget", 1), ("seed", 0)):
            object.__setattr__(self, key, _whole(self.name, key, getattr(self, key), least))
        if self.runs > MOST_RUNS:
            raise SearchError(
                f"Study {self.name!r}: runs is {self.runs}; a study has at most {MOST_RUNS} runs of a method."
            )
        chunk = default_chunk(self.runs) if self.chunk is None else _whole(self.name, "chunk", self.chunk, 1)
        object.__setattr__(self, "chunk", chunk)
        object.__setattr__(self, "methods", _methods(self.name, self.methods))
        object.__setattr__(self, "settings", _settings(self.name, self.settings, self.methods))
        for method in self.methods:
            registry.make(method, **self.settings.get(method, {}))

    def record(self) -> dict[str, Any]:
        """The plan as JSON types; `Plan.from_record` is the inverse."""
        return plain(asdict(self))

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Plan":
        """A plan from `record()`. Raises SearchError for one with other keys, as of a newer plantfit or a damaged
        database."""
        needed, known = {"name", "methods"}, {f.name for f in fields(cls)}
        odd = sorted(needed - {*record}) or sorted({*record} - known)
        if odd:
            has = "lacks" if odd[0] in needed else "has the unknown"
            raise SearchError(
                f"The stored plan {has} {', '.join(map(repr, odd))[:200]}; it is of a newer "
                "plantfit or damaged, so update plantfit, or restore the database from a copy."
            )
        return cls(**dict[str, Any](record, methods=tuple(record["methods"])))


@dataclass(frozen=True)
class Task:
    """Runs `first` to `first + count - 1` of one method: the unit that a worker claims."""

    method: str
    first: int
    count: int


def tasks(plan: Plan) -> tuple[Task, ...]:
    """The plan in chunks, a function of the plan alone.

    The methods take turns, so that a study that is half done has half of the runs of each and can be compared.
    """
    chunk = plan.chunk or default_chunk(plan.runs)
    return tuple(
        Task(method, first, min(chunk, plan.runs - first))
        for first in range(0, plan.runs, chunk)
        for method in plan.methods
    )


def default_chunk(runs: int) -> int:
    """Runs in one task. Runs of a population method share compiled loops, so that larger tasks cost less a run
    (docs/studies.md has figures); smaller ones leave more to share and less to lose."""
    return min(max(-(-runs // TASKS_OF_METHOD), SMALLEST_CHUNK), LARGEST_CHUNK)


def default_budget(dimension: int) -> int:
    """Evaluations of a run when the user gives none."""
    return max(6000, 1500 * dimension)


def _whole(name: str, key: str, value: Any, least: int) -> int:
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise SearchError(f"Study {name!r}: {key} is {value!r}; give a whole number.")
    number = value.__index__()
    if not least <= number < LIMIT:
        raise SearchError(
            f"Study {name!r}: {key} is {number}; give a whole number of at least {least} and below {LIMIT}."
        )
    return number


def _methods(name: str, methods: Any) -> tuple[str, ...]:
    chosen = (methods,) if isinstance(methods, str) else tuple(methods)
    if not chosen:
        raise SearchError(f"Study {name!r} has no methods; name at least one, for example 'auto'.")
    for k, method in enumerate(chosen):
        if not isinstance(method, str):
            raise SearchError(f"Study {name!r}: method {method!r} is not a name; write it as text, for example 'auto'.")
        if method in chosen[:k]:
            raise SearchError(
                f"Study {name!r}: method {method!r} is named twice; name it once, and raise runs for more runs."
            )
    return chosen


def _settings(name: str, settings: Any, methods: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    if not isinstance(settings, Mapping):
        raise SearchError(f"Study {name!r}: settings is {settings!r}; give a table of settings for each method.")
    for method, own in settings.items():
        if method not in methods:
            raise SearchError(
                f"Study {name!r} has settings for {method!r}, which is not "
                f"one of its methods {list(methods)}; add or remove it."
            )
        if not isinstance(own, Mapping):
            raise SearchError(
                f"Study {name!r}: the settings of {method!r} are {own!r}; give a table of names and values."
            )
    # through JSON types at once, so that a resumed study gets the very same settings
    return plain(settings)
