"""Events, friction, backlash and late states written as text: equal to the Python declaration, and the place of
every mistake."""

from typing import Any

import numpy as np
import pytest
from model_calls import derivative

from plantfit.errors import EquationError, ModelError
from plantfit.models import Backlash, Declared, Event, Friction, Model, StateDelay, Table, describe, equations
from plantfit.simulate.steps.switching import bind_backlash, bind_event, bind_friction
from plantfit.simulate.steps.vector import vectorise

import jax.numpy as jnp

STATES = {"x": "m", "v": "m/s", "z": "m"}
PARAMETERS = {"k": "N/m", "b": "N*s/m", "Fc": "N", "Fs": "N", "m": "kg", "gap": "m", "c": "", "tau": "s"}
TEXT = """
    x' = v
    net = F - k*delay(x, tau) - b*v          # friction may also stand in an intermediate
    v' = (net - friction(v, Fc + k*abs(x), Fs))/m
    z = play(x + 2*v*tau, gap)
    when falling(x): v = -c*v, x = 0
    when crossing(v - F/b): x = x/2
    y = z
"""
VALUES = {"k": 3.0, "b": 0.5, "Fc": 2.0, "Fs": 2.5, "m": 4.0, "gap": 0.1, "c": 0.8, "tau": 0.3}
X, U = {"x": -0.7, "v": 1.3, "z": 0.2}, {"F": 1.7, "delay(x, tau)": 0.4, "t": 2.0}


def from_text(**changes) -> Model:
    given: dict[str, Any] = {
        "inputs": {"F": "N"}, "states": STATES, "outputs": {"y": "m"}, "parameters": PARAMETERS,
    }  # fmt: skip
    return equations(changes.pop("text", TEXT), **{**given, **changes})


def by_hand() -> Model:
    return Model(
        name="user",
        states=STATES,
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters=tuple(Declared(n, u) for n, u in PARAMETERS.items()),
        output=lambda x, u, p: {"y": x["z"]},
        derivative=lambda x, u, p: {
            "x": x["v"],
            "v": (u["F"] - p["k"] * u["delay(x, tau)"] - p["b"] * x["v"]) / p["m"],
            "z": 0.0 * x["z"],
        },
        state_delays=(StateDelay("delay(x, tau)", "x", "tau"),),
        events=(
            Event("bounce", lambda x, u, p: x["x"], lambda x, u, p: {"v": -p["c"] * x["v"], "x": 0.0 * x["x"]}),
            Event("fast", lambda x, u, p: x["v"] - u["F"] / p["b"], lambda x, u, p: {"x": x["x"] / 2}, "both"),
        ),
        frictions=(
            Friction(
                "v",
                lambda x, u, p: p["Fc"] + p["k"] * jnp.abs(x["x"]),
                lambda x, u, p: p["Fs"],
                lambda x, u, p: {"v": 1 / p["m"]},
            ),
        ),
        backlashes=(Backlash("z", lambda x, u, p: x["x"] + 2 * x["v"] * p["tau"], lambda x, u, p: p["gap"]),),
    )


def everything(model: Model) -> list[np.ndarray]:
    """All functions of a model at one point, as the simulation binds them."""
    vector = vectorise(model)
    at = (
        tuple(X[n] for n in vector.states),
        tuple(U[n] for n in vector.channels),
        tuple(VALUES[n] for n in vector.parameters),
    )
    events = [bind_event(e, vector) for e in model.events]
    found = [vector.rate(*at), vector.output(*at)]
    found += [value for e in events for value in (e.when(*at), e.then(*at), e.sign)]
    for friction in (bind_friction(f, vector) for f in model.frictions):
        found += [friction.velocity, friction.sliding(*at), friction.breakaway(*at), friction.effect(*at)]
    for play in (bind_backlash(b, vector) for b in model.backlashes):
        found += [play.state, play.drive(*at), play.gap(*at)]
    return [np.asarray(v, dtype=float) for v in found]


def test_the_text_equals_the_declaration():
    one, two = from_text(), by_hand()
    assert one.state_delays == two.state_delays
    assert vectorise(one).channels == ("F", "delay(x, tau)", "t")
    found, expected = everything(one), everything(two)
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-300)


def test_every_function_takes_whole_batches():
    model = from_text()
    x, u = ({n: np.full(5, v) for n, v in at.items()} for at in (X, U))
    assert model.events[0].then(x, u, VALUES)["v"].shape == (5,)
    assert model.frictions[0].effect(x, u, VALUES)["v"].shape == (5,)
    assert derivative(model)(x, u, VALUES)["z"].tolist() == [0.0] * 5


def test_friction_acts_on_every_state_that_its_force_moves():
    # two masses on each other: the force on the first acts on the second with the other sign
    model = equations(
        "force = friction(v, R); v' = (F - force)/m; w' = force/m - w",
        inputs=["F"], states=["v", "w"], outputs=["v"], parameters=["R", "m"],
    )  # fmt: skip
    friction = model.frictions[0]
    at = {"v": 0.3, "w": 0.2}, {"F": 1.0, "t": 0.0}, {"R": 2.0, "m": 4.0}
    assert {n: float(v) for n, v in friction.effect(*at).items()} == {"v": 0.25, "w": -0.25}
    assert float(friction.sliding(*at)) == float(friction.breakaway(*at)) == 2.0
    assert float(derivative(model)(*at)["w"]) == -0.2


def test_a_fixed_state_delay_is_a_parameter_with_a_value():
    model = equations("x' = -delay(x, 0.5); y = delay(x, 0.5)", states=["x"], outputs=["y"])
    (late,) = model.state_delays
    assert model.declared(late.parameter).value == 0.5
    assert float(model.output({"x": 1.0}, {"t": 0.0, late.channel: 7.0}, {late.parameter: 0.5})["y"]) == 7.0


def test_names_that_look_like_the_new_words_stay_free():
    model = equations("friction = 2*x; play = friction; when = play; x' = when; y = x", states=["x"], outputs=["y"])
    assert float(derivative(model)({"x": 3.0}, {}, {})["x"]) == 6.0
    assert (model.events, model.frictions, model.backlashes) == ((), (), ())


def test_the_description_names_them():
    shown = describe(from_text())
    for words in ("x delayed by tau", "falling(x) in line 6", "dry friction", "follows with play"):
        assert words in shown


PLACES = [
    # text after x' = v, line, column, part of the message
    ("v' = F/m\nwhen x < 0: v = 0", 2, 5, "After 'when' an event is needed"),
    ("v' = F/m\nwhen sinking(x): v = 0", 2, 5, "falling, rising or crossing"),
    ("v' = F/m\nwhen falling(): v = 0", 2, 13, "There is nothing in falling()"),
    ("v' = F/m\nwhen falling(x) v = 0", 2, 16, "a ':' and a state that jumps are needed"),
    ("v' = F/m\nwhen falling(x): ", 2, 15, "A state and its new value are missing"),
    ("v' = F/m\nwhen falling(x): v = 0,", 2, 15, "A state and its new value are missing"),
    ("v' = F/m\nwhen falling(x): v", 2, 17, "There is no '='"),
    ("v' = F/m\nwhen falling(x): v = -w", 2, 22, "'w' is not known"),
    ("v' = F/m\nwhen falling(h): v = 0", 2, 13, "'h' is not known"),
    ("v' = F/m\nwhen falling(x, v): v = 0", 2, 14, "A comma outside"),
    ("v' = F/m\nwhen falling(x): v = 0, F = 1", 2, 24, "'F' is not a state"),
    ("v' = F/m\nwhen falling(x): v = 0, v = 1", 2, 24, "set twice"),
    ("v' = F/m\nwhen falling(x): v' = 0", 2, 17, "An event sets the state itself"),
    ("v' = F/m\ny2 = falling(x)", 2, 5, "only after 'when'"),
    ("v' = (F + friction(v, R))/m", 1, 10, "speeds up 'v'; subtract it"),
    ("v' = (F - friction(v, R))/(-m)", 1, 10, "speeds up 'v'"),
    ("v' = F/m; y2 = friction(v, R)", 1, 15, "does not slow 'v'"),
    ("v' = F*friction(v, R)*friction(v, R)/m", 1, 21, "must enter linearly"),
    ("v' = sin(F - friction(v, R))/m", 1, 5, "must enter linearly"),
    ("v' = F/(m + friction(v, R))", 1, 6, "must enter linearly"),
    ("v' = (F - friction(v, R) + 2*friction(v, R))/m", 1, 25, "enters here with + and with -"),
    ("v' = (F - friction(v, R))/m - friction(v, 2*R)", 1, 30, "another friction in line 2"),
    ("v' = (F - friction(F, R))/m", 1, 19, "takes the velocity first"),
    ("v' = (F - friction(v))/m", 1, 10, "takes 2 to 3 arguments"),
    ("v' = (F - friction(v, r))/m", 1, 22, "'r' is not known. Did you mean 'R'?"),
    ("f = friction(v, R); v' = (F - f)/m; y = f", 1, 4, "acts in derivatives only"),
    ("v' = (F - friction(v, R + friction(x, R)))/m", 1, 26, "acts in derivatives only"),
    ("v' = (F - friction(v, friction(v, R)))/m", 1, 10, "another friction"),
    ("v' = F/m\nz = play(x, R) + 1", 2, 0, "'z' is a state; write z' = ..."),
    ("v' = play(x, R)", 1, 5, "play() must stand alone"),
    ("v' = F/m\ny2 = 2*play(x, R)", 2, 7, "play() must stand alone"),
    ("v' = F/m\nz = play(x, -1)", 2, 12, "The gap of play() is negative"),
    ("v' = F/m\nz = play(x + w, R); w = 2*z", 2, 9, "cannot drive itself"),
    ("v' = F/m\nz = play(x, R); z' = 2", 2, 16, "'z' has an equation already"),
    ("v' = F/m\nz = play(x, R)\nwhen falling(x): z = 0", 3, 17, "given by play() and cannot jump"),
    ("v' = delay(x, 0)", 1, 14, "A state 0 s ago is the state itself"),
    ("v' = delay(m, 1)", 1, 11, "the name of an input or a state"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), PLACES)
def test_place_and_message(text, line, column, message):
    states = (
        ["x", "v", "z"] if "play(" in text and text.split("\n")[-1].lstrip().startswith(("z", "when")) else ["x", "v"]
    )
    output = "" if "y = " in text else "; y = x"
    with pytest.raises(EquationError) as caught:
        equations("x' = v\n" + text + output, inputs=["F"], states=states, outputs=["y"], parameters=["m", "R"])
    assert (message in caught.value.reason, caught.value.line, caught.value.column) == (True, line, column), str(
        caught.value
    )


MISFITS = [
    ("when falling(x): v = -c*v", "when falling(x): v = -c*x", "new value of 'v' must be in m/s"),
    ("when falling(x)", "when falling(x + v)", "joins"),
    ("Fs))/m", "m))/m", "joins"),
    ("play(x +", "play(v +", "joins"),
    (", gap)", ", tau)", "joins"),
    ("delay(x, tau)", "delay(x, c)", "A delay must be in s"),
]


@pytest.mark.parametrize(("old", "new", "message"), MISFITS)
def test_units_are_followed(old, new, message):
    assert old in TEXT
    text = f"{TEXT.replace(old, new)}\n used = {'*'.join(PARAMETERS)}"
    with pytest.raises(EquationError, match=message):
        from_text(text=text)
    from_text(text=text, check=False)


def declared(**changes) -> Model:
    return Model(**{**by_hand().__dict__, **changes})


CONTRADICTIONS = [
    ({"state_delays": (StateDelay("late", "q", "tau"),)}, "delays the state 'q', which is not one of its states"),
    ({"state_delays": (StateDelay("late", "x", "T"),)}, "delays by 'T', which is not one of its parameters"),
    ({"state_delays": (StateDelay("F", "x", "tau"),)}, "the channel 'F' is declared twice"),
    ({"state_delays": (StateDelay("late", "z", "tau"),)}, "follows with backlash; delay what drives it"),
    ({"events": (Event("e", lambda x, u, p: x["x"], lambda x, u, p: {}, "down"),)}, "has direction 'down'"),  # pyrefly: ignore[bad-argument-type]
    ({"events": by_hand().events * 2}, "the event 'bounce' is declared twice"),
    ({"frictions": by_hand().frictions * 2}, "the friction 'v' is declared twice"),
    (
        {"backlashes": (Backlash("q", lambda x, u, p: 0, lambda x, u, p: 0),)},
        "backlash acts on 'q', which is not one of its states",
    ),
    ({"backlashes": (Backlash("v", lambda x, u, p: 0, lambda x, u, p: 0),)}, "'v' has friction and backlash"),
    ({"tables": (Table("k", ("x",), ((0.0, 1.0),)),)}, "nodes of shape (2,), but its parameter has shape ()"),
    ({"tables": (Table("q", ("x",), ((0.0, 1.0),)),)}, "the table 'q', which is not one of its parameters"),
]


@pytest.mark.parametrize(("changes", "message"), CONTRADICTIONS)
def test_a_model_that_contradicts_itself_is_refused(changes, message):
    with pytest.raises(ModelError) as caught:
        declared(**changes)
    assert message in str(caught.value)
