"""Everything that `plantfit` offers by name: exported, listed alike, and explained."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from face_plants import line

import plantfit as pf
from plantfit.errors import ModelError, SearchError
from plantfit.listing import Listed

ROOT = Path(__file__).resolve().parents[2]


def test_methods_and_models_are_listed_and_made_alike():
    for room, name in ((pf.methods, "cmaes"), (pf.models, "dc_motor")):
        listing = room.listing()
        assert [one.name for one in listing] == list(room.names())
        assert all(isinstance(one, Listed) and one.sentence and one.source for one in listing)
        one = next(one for one in listing if one.name == name)
        assert type(one.make()) is type(room.make(name))
        text = room.describe(name)
        assert text.startswith(f"{name}: {one.sentence}\nsource: {one.source}")
        for option in one.options:
            assert re.search(rf"^  {option.name} ", text, re.M)


def test_options_of_both_are_those_that_can_be_given():
    for one in pf.methods.listing():
        assert one.make(**{o.name: o.default for o in one.options}) == one.make()
    for one in pf.models.listing():
        assert one.make(**{o.name: o.default for o in one.options}).parameters == one.make().parameters


@pytest.mark.parametrize(
    ("room", "near", "error"), [(pf.methods, "cmes", SearchError), (pf.models, "dc_moter", ModelError)]
)
def test_unknown_names_and_options_are_told(room, near, error):
    for asked in (lambda: room.make(near), lambda: room.describe(near)):
        with pytest.raises(error, match=f"no (method|model) '{near}'.*Did you mean"):
            asked()
    with pytest.raises(error, match=r"no (setting|option) 'nonsense'"):
        room.make(room.names()[1] if room is pf.methods else "dc_motor", nonsense=1)


def test_methods_called_as_earlier_programs_do():
    assert [m["name"] for m in pf.methods()] == list(pf.methods.names())  # pyrefly: ignore[not-callable]


def test_a_description_of_an_instance_and_of_a_model():
    assert pf.methods.describe(pf.methods.make("pso")) == pf.methods.describe("pso")
    model = pf.models.make("first_order")
    assert pf.models.describe("first_order").endswith(pf.models.describe(model))


@pytest.mark.thorough
def test_minimise_with_what_is_exported():
    objective = pf.Objective(dimension=2, costs=lambda z: ((z - 0.3) ** 2).sum(axis=1))
    seen = []
    runs = pf.minimise(objective, pf.methods.make("cmaes"), runs=2, budget=1500, progress=seen.append)
    assert all(isinstance(run, pf.RunResult) and isinstance(run.status, pf.Status) for run in runs)
    assert min(run.cost for run in runs) < 1e-8
    assert seen
    assert isinstance(seen[-1], pf.Progress)


@pytest.mark.thorough
def test_fit_takes_an_instance():
    problem, u, y = line()
    answer = pf.fit(problem, pf.methods.make("pso"), budget=400)
    assert answer.runs[0].method == "pso"
    np.testing.assert_allclose(list(answer.values.values()), np.polyfit(u, y, 1), rtol=1e-5)
    best = pf.minimise(pf.objective_of(problem), "least_squares", budget=200)[0]
    np.testing.assert_allclose(problem.space.physical(best.x), np.polyfit(u, y, 1), rtol=1e-4)


def test_every_name_is_there_and_the_editor_sees_the_same():
    text = (ROOT / "src" / "plantfit" / "__init__.py").read_text("utf-8")
    seen = text.split("if TYPE_CHECKING:")[1].split("__version__")[0]
    for name in pf.__all__:
        assert getattr(pf, name) is not None
        assert re.search(rf"\b{name}\b", seen), f"{name} is not imported for editors"


def test_every_name_of_the_page_on_python_is_there():
    page = (ROOT / "docs" / "python.md").read_text("utf-8")
    for dotted in sorted(set(re.findall(r"\bpf((?:\.\w+)+)", page))):
        value = pf
        for name in dotted[1:].split("."):
            value = getattr(value, name)
    for name in sorted(set(re.findall(r"\banswer\.(\w+)", page))):
        assert hasattr(pf.Answer, name) or name in pf.Answer.__dataclass_fields__, name


def _definitions(value, path, seen):
    """(path, docstring) of a class or function, and of what is public in it."""
    if inspect.ismodule(value):
        for name in value.__all__:
            yield from _definitions(getattr(value, name), f"{path}.{name}", seen)
    elif (inspect.isclass(value) or inspect.isfunction(value)) and id(value) not in seen:
        seen.add(id(value))
        text = value.__dict__.get("__doc__") if inspect.isclass(value) else value.__doc__
        made = inspect.isclass(value) and text is not None and text.startswith(f"{value.__name__}(")  # by dataclass
        yield path, "" if made else text
        for name, member in vars(value).items() if inspect.isclass(value) else ():
            inner = (
                getattr(member, "fget", None)
                or getattr(member, "func", None)
                or getattr(member, "__func__", None)
                or member
            )
            if not name.startswith("_") and inspect.isfunction(inner):
                yield f"{path}.{name}", inner.__doc__


def test_every_public_definition_is_explained():
    seen: set[int] = set()
    found = [d for name in pf.__all__ for d in _definitions(getattr(pf, name), name, seen)]
    assert len(found) > 180
    assert not [path for path, text in found if not (text or "").strip()]


def test_the_check_of_docstrings_sees_what_is_missing():
    class Bare:
        """Has a method without a word."""

        def silent(self): ...

    assert [path for path, text in _definitions(Bare, "Bare", set()) if not text] == ["Bare.silent"]
