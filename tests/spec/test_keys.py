"""A misspelt key is named with the one that was meant, in every table; names of steppers and controllers are those of
their tables."""

import subprocess
import sys
from pathlib import Path

import pytest

from plantfit.control.tune.forms.names import CONTROLLERS, REGULATOR
from plantfit.errors import SpecError
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.spec.tables import json_schema, validated

HEAD = 'name = "s"\n[recording.a]\nfile = "x.csv"\n'


def refused(text):
    with pytest.raises(SpecError) as raised:
        validated(text, Path("s.toml"))
    return str(raised.value)


@pytest.mark.parametrize(
    ("text", "key", "meant"),
    [
        (f"{HEAD}[model.filter_alike]\ncutof = 5", "model.filter_alike.cutof", "cutoff"),
        (f"{HEAD}[model.filter_alike]\ncutoff = 5\nordr = 3", "model.filter_alike.ordr", "order"),
        (f'{HEAD}[model.tables.k]\novr = "x"\nnodes = [1]', "model.tables.k.ovr", "over"),
        (f'{HEAD}[model.states.x]\nunt = "m"', "model.states.x.unt", "unit"),
        (f'{HEAD}[recording.b]\nfil = "y.csv"\n[model]', "recording.b.fil", "file"),
        (f"{HEAD}[recording.b]\nvalidat = true\n[model]", "recording.b.validat", "validate"),
        (f"{HEAD}[modl]", "modl", "model"),
        (f"{HEAD}[model]\n[regression]\nbnd = 3", "regression.bnd", "band"),
        (f"{HEAD}[model]\n[parameters.a]\nbouds = [1, 2]", "parameters.a.bouds", "bounds"),
        (f"{HEAD}[model]\n[propagation]\ndraw = 30", "propagation.draw", "draws"),
    ],
)
def test_a_misspelt_key_is_named_with_the_one_that_was_meant(text, key, meant):
    assert refused(text) == f"s.toml: key {key!r} is not known; did you mean {meant!r}?"


def test_states_may_be_names_alone():
    named = validated(f'{HEAD}[model]\nstates = ["x", "v"]', Path("s.toml")).model.states
    assert named == validated(f"{HEAD}[model.states]\nx = {{}}\nv = {{}}", Path("s.toml")).model.states
    assert "write names as text" in refused(f"{HEAD}[model]\nstates = [1]")


def test_a_key_that_is_missing_is_asked_for():
    assert (
        refused(f"{HEAD}[model.filter_alike]\norder = 3")
        == "s.toml: key 'model.filter_alike.cutoff' is missing; add it."
    )


def test_steppers_of_the_study_file_are_those_of_the_table():
    assert json_schema()["$defs"]["SimulationTable"]["properties"]["stepper"]["enum"] == list(STEPPERS)
    *first, last = (repr(name) for name in STEPPERS)
    said = refused(f'{HEAD}[model]\n[simulation]\nstepper = "rk5"')
    assert said == (f"s.toml: simulation.stepper = 'rk5' cannot be used: write {', '.join(first)} or {last}.")
    for name in STEPPERS:
        assert validated(f'{HEAD}[model]\n[simulation]\nstepper = "{name}"', Path("s.toml")).simulation.stepper == name


def test_controllers_of_the_study_file_are_those_of_the_list_and_load_no_jax():
    assert json_schema()["$defs"]["ControlTable"]["properties"]["controller"]["enum"] == [*CONTROLLERS, REGULATOR]
    assert "control.controller = 'pidd' cannot be used: write 'pid', 'pi'" in refused(
        f'{HEAD}[model]\n[control]\ncontroller = "pidd"'
    )
    loaded = "import sys, plantfit.spec.tables; print([m for m in ('jax', 'scipy', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]", (
        "keep slow packages out of what spec/tables.py imports: a slip in a study file is told at once"
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "[model]\n[parameters.a]\nbounds = [5]",
            "parameters.a.bounds = [5] cannot be used: write two numbers in brackets, as in [0, 10].",
        ),
        (
            "[model]\n[parameters.a]\nbounds = '0..5'",
            "parameters.a.bounds = '0..5' cannot be used: write two numbers in brackets",
        ),
        (
            "[model]\n[parameters.a]\nvalue = '2 s'",
            "parameters.a.value = '2 s' cannot be used: write a number without quotation marks; its unit",
        ),
        (
            "[model]\n[search]\nmethods = 'auto'",
            "search.methods = 'auto' cannot be used: write a list in brackets, as in [\"auto\"].",
        ),
        (
            "[model]\n[search]\nruns = 'many'",
            "search.runs = 'many' cannot be used: write a whole number without quotation marks.",
        ),
        ("[model]\n[search]\nruns = 1.5", "search.runs = 1.5 cannot be used: write a whole number."),
        ("[model]\n[scales]\ny = -1", "scales.y = -1 cannot be used: write a number above 0."),
        ("[model]\ninputs = 'u'", "model.inputs = 'u' cannot be used: write a table, as in { NAME = VALUE }."),
        (
            "[model.states]\nx = { initial = [1] }",
            "model.states.x.initial = [1] cannot be used: write a number or text in quotation marks.",
        ),
        ("[model]\n[estimate]\nmethods = []", "estimate.methods = [] cannot be used: write a list of at least 1."),
        (
            "[model]\n[parameters.L]\nvalue = 30\nbounds = [0, 20]",
            "parameters.L cannot be used: its value 30 lies beyond its bounds 0 to 20; correct one of them",
        ),
        (
            "[model]\n[recording.b]\nfile = 'b.csv'\nsplit = 70",
            "recording.b.split = 70 cannot be used: write a number below 1, as 0.7 for 70 %.",
        ),
        ("[model]\n[control]\nms = 0.5", "control.ms = 0.5 cannot be used: write a number above 1."),
    ],
)
def test_a_wrong_value_is_explained_in_words_of_a_study_file(text, told):
    assert f"s.toml: {told}" in refused(f"{HEAD}{text}")


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [("s.toml", '{"name": "a"}', "looks like JSON"), ("a.csv", "t,u\n0,1", "`plantfit init a.csv`")],
)
def test_a_file_of_another_kind_is_recognised(name, text, told):
    with pytest.raises(SpecError, match="is not valid TOML") as caught:
        validated(text, Path(name))
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("place", "key", "home"),
    [
        ("[recording.a]", "hold = {}", "[model] or [control]"),
        ("[model]", "split = 0.7", "[recording.NAME]"),
        ("[model]", 'balance = "samples"', "no table, at the top of the file"),
        ("[model]", "budget = 3", "[search] or [estimate]"),
    ],
)
def test_a_key_of_another_table_is_told_its_place(place, key, home):
    said = refused(f"{HEAD}[model]\n".replace(place, f"{place}\n{key}", 1))
    assert said.endswith(f"is not known; it stands under {home}.")


def test_a_key_of_another_table_that_is_like_one_there_is_asked_for():
    said = refused(f"{HEAD}seed = 3\n[model]\n")
    assert said.endswith("is not known; did you mean 'sheet'? Or is it meant for [search] or [estimate]?")


def test_a_key_of_no_table_is_not():
    assert "; known there: " in refused(f"{HEAD}[model]\nzebra = 1")
