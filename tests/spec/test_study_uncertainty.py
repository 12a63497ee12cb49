"""The tables [uncertainty.NAME] of a study file: what they become, and what is said when one cannot be used."""

import numpy as np
import pytest

from plantfit import spec
from plantfit.errors import RecordingError, SpecError, UnitError
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import type_a, type_b

STUDY = """\
name = "loop"
[recording.a]
file = "a.csv"
[recording.b]
file = "a.csv"
[model]
equations = '''
i' = (u - R*i)/(c*L)
y = i
v = 100*i
'''
inputs = { u = "V" }
states = { i = "A" }
outputs = { y = "A", v = "%" }
constants = { c = "1" }
check_units = false
[parameters.R]
value = 2000.0
unit = "mohm"
[parameters.L]
bounds = [0.1, 10]
unit = "H"
"""


@pytest.fixture(scope="module")
def parse(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    rows = "\n".join(f"{0.1 * k:.1f},1.0,{0.01 * k:.2f},{k}" for k in range(30))
    (folder / "a.csv").write_text("t [s],u [V],y [A],v [%]\n" + rows)

    def parsed(tables: str) -> spec.Study:
        return spec.parse(STUDY + tables, folder / "loop.toml")

    return parsed


def one(parse, body: str) -> SharedError:
    [error] = parse(f"[uncertainty.meter]\n{body}").errors
    return error


def test_every_way_to_say_a_size(parse):
    head = 'of = "y"\nkind = "offset"\n'
    assert one(parse, head + "limit = 0.1") == SharedError(type_b("meter", 0.1, "A"), "offset", "y")
    assert one(parse, head + 'limit = 0.1\nshape = "triangular"').source == type_b("meter", 0.1, "A", "triangular")
    assert one(parse, head + "standard = 0.1\ndegrees_of_freedom = 4").source.standard == 0.1
    assert one(parse, head + "standard = 0.1\ndegrees_of_freedom = 4").source.degrees_of_freedom == 4
    assert one(parse, head + "expanded = 0.1").source == type_b("meter", 0.1, "A", "normal", k=2.0)
    assert one(parse, head + "expanded = 0.1\nk = 3").source.standard == pytest.approx(0.1 / 3)
    assert one(parse, head + "repeats = [0.1, 0.3, 0.2]").source == type_a("meter", [0.1, 0.3, 0.2], "A")


def test_units_become_those_of_what_is_uncertain(parse):
    def limit(body: str) -> float:
        return one(parse, body).source.limit

    assert limit('of = "y"\nkind = "offset"\nlimit = 20\nunit = "mA"') == pytest.approx(0.02)
    assert limit('of = "y"\nkind = "offset"\nlimit = 0.5\nunit = "%"\nspan = 4.0') == pytest.approx(0.02)  # of the span
    assert limit('of = "v"\nkind = "offset"\nlimit = 0.5\nunit = "%"') == 0.5  # a signal in % already
    assert limit('of = "v"\nkind = "zero"\nlimit = 1000\nunit = "ppm"\nspan = 100.0') == pytest.approx(0.1)
    assert limit('of = "y"\nkind = "gain"\nlimit = 0.5\nunit = "%"') == pytest.approx(0.005)
    assert limit('of = "y"\nkind = "gain"\nlimit = 5\nunit = "mV/V"') == pytest.approx(0.005)
    assert limit('of = "clock"\nlimit = 20\nunit = "ppm"') == pytest.approx(2e-5)
    assert limit('of = "clock"\nlimit = 0.864\nunit = "s/d"') == pytest.approx(1e-5)
    held = parse('[uncertainty.bridge]\nof = "R"\nlimit = 20')  # in the unit that its value stands in
    value = float(held.problem.space.parameters["R"].value)
    assert held.errors[0].source.limit == pytest.approx(0.01 * value)
    assert limit('of = "R"\nlimit = 1\nunit = "%"') == pytest.approx(0.01 * value)  # of the value
    assert limit('of = "R"\nlimit = 0.02\nunit = "ohm"') == pytest.approx(0.01 * value)


def test_signals_that_share_an_error(parse):
    assert one(parse, 'of = ["u", "y"]\nkind = "gain"\nlimit = 1\nunit = "%"').of == ("u", "y")
    assert one(parse, 'of = ["y"]\nkind = "offset"\nlimit = 1\nunit = "mA"').of == "y"


def test_recordings_clock_and_draws(parse):
    study = parse(
        '[uncertainty.zero]\nof = "y"\nkind = "offset"\nlimit = 1\nper_recording = true\nrecordings = '
        '["b"]\n[propagation]\ndraws = 50'
    )
    assert study.errors[0].recordings == ("b",)
    assert study.errors[0].per_recording
    assert study.draws == 50
    assert one(parse, 'of = "clock"\nstandard = 1e-4').kind == "clock"
    assert (parse("").errors, parse("").draws) == ((), None)


@pytest.mark.parametrize(
    ("body", "error", "said"),
    [
        ('of = "z"\nkind = "gain"\nlimit = 0.1', SpecError, "of = 'z' is not a signal .* There are u, y, v, clock, R"),
        ('of = "clok"\nlimit = 0.1', SpecError, "did you mean 'clock'"),
        ('of = "y"\nkind = "gain"', SpecError, "the size is missing: give limit"),
        ('of = "y"\nlimit = 0.1', SpecError, "kind is missing; add how 'y' errs"),
        ('of = "y"\nkind = "gain"\nlimit = -0.1', SpecError,
         "limit = -0.1 cannot be used; an uncertainty has no sign, so write 0.1"),
        ('of = "y"\nkind = "gain"\nlimit = nan', SpecError, "limit = nan cannot be used; give a number of at least 0"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nstandard = 0.1', SpecError, "gives limit and standard; keep one"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nk = 2', SpecError,
         "k can be used only with expanded, but limit is given"),
        ('of = "y"\nkind = "gain"\nstandard = 0.1\nshape = "rectangular"', SpecError,
         "shape can be used only with limit, but "
            "standard is given"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nshape = "normal"', SpecError,
         "a normal distribution has no limit; give standard"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nshape = "round"', SpecError,
         "meter.shape = .round. cannot be used: .*'triangular'"),
        ('of = "y"\nkind = "gain"\nlimits = 0.1', SpecError,
         "key 'uncertainty.meter.limits' is not known; did you mean 'limit'"),
        ('of = "y"\nkind = "gain"\nrepeats = [0.1]', SpecError, "uncertainty.meter.repeats"),
        ('of = "y"\nkind = "gain"\nrepeats = [0.1, nan]', SpecError,
         "repeats = .* has values that are not finite numbers"),
        ('of = "y"\nkind = "gain"\nrepeats = [0.1, 0.2]\ndegrees_of_freedom = 3', SpecError,
         "the degrees of freedom follow "
            "from repeats"),
        ('of = "y"\nkind = "gain"\nlimit = 5', SpecError,
         'error of the gain is 500 %, which is too large; for one per cent write 0.01'),
        ('of = "y"\nkind = "gain"\nlimit = 5\nunit = "mA"', UnitError, "a gain is relative, and 'mA' is not"),
        ('of = "clock"\nlimit = 5\nunit = "s"', UnitError, "a clock is relative, and 's' is not"),
        ('of = "y"\nkind = "offset"\nlimit = 5\nunit = "bar"', UnitError,
         "unit = 'bar' cannot be converted to 'A', the unit of 'y'"),
        ('of = "y"\nkind = "offset"\nlimit = 5\nunit = "banana"', UnitError, "'banana' is not a known unit"),
        ('of = "y"\nkind = "offset"\nlimit = 5\nunit = "%"', SpecError, "unit = '%' is a share of the span: give span"),
        ('of = "y"\nkind = "zero"\nlimit = 5', SpecError, "kind = 'zero' needs span"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nspan = 3', SpecError,
         'for a share of the span use kind = "full scale"'),
        ('of = "R"\nkind = "gain"\nlimit = 0.1', SpecError,
         "kind = 'gain' is only for signals, but 'of' names the parameter 'R'"),
        ('of = "R"\nlimit = 0.1\nspan = 1', SpecError, "span is only for signals"),
        ('of = "R"\nlimit = 0.1\nper_recording = true', SpecError, "'R' is one number for all recordings"),
        ('of = ["u", "y"]\nkind = "offset"\nlimit = 0.1', SpecError, r"units .u in V, y in A. cannot share one offset"),
        ('of = ["y", "R"]\nkind = "gain"\nlimit = 0.1', SpecError, "of names the parameter 'R' together with others"),
        ('of = ["y", "z"]\nkind = "gain"\nlimit = 0.1', SpecError, "of = 'z' is not a signal"),
        ("of = 3\nlimit = 0.1", SpecError, "meter.of = 3 cannot be used"),
        ('of = "L"\nlimit = 0.1', SpecError, "'L' is fitted, so its uncertainty comes from the data"),
        ('of = "c"\nlimit = 0.1', SpecError, "'c' is a constant of .model., and constants have no uncertainty"),
        ('of = "i"\nlimit = 0.1', SpecError, "of = 'i' is not a signal"),
        ('of = "y"\nkind = "gain"\nlimit = 0.1\nrecordings = ["c"]', SpecError,
         "recordings names 'c', which is not there"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_one_sentence(parse, body, error, said):
    with pytest.raises(error, match=said) as caught:
        parse(f"[uncertainty.meter]\n{body}")
    text = str(caught.value)
    assert text.startswith("loop.toml")
    assert "uncertainty.meter" in text
    assert "\n" not in text


def test_a_list_of_tables_and_few_draws_are_refused(parse):
    with pytest.raises(SpecError, match=r"write \[uncertainty.NAME\], a table with a name of its own"):
        parse('[[uncertainty]]\nof = "y"')
    with pytest.raises(SpecError, match=r"propagation\.draws = 3 cannot be used"):
        parse("[propagation]\ndraws = 3")
    with pytest.raises(SpecError, match="did you mean 'draws'"):
        parse("[propagation]\ndraw = 30")


def test_python_refuses_unknown_signals_and_recordings(parse):
    problem = parse("").problem
    z = np.full(problem.space.dimension, 0.4)
    from plantfit.trust import propagate

    with pytest.raises(RecordingError, match="has no signal 'w'"):
        propagate(problem, z, [SharedError(type_b("meter", 0.1), "gain", "w")])
    with pytest.raises(RecordingError, match="names recording 'c'; there are"):
        propagate(problem, z, [SharedError(type_b("meter", 0.1), "gain", "y", recordings=("c",))])
