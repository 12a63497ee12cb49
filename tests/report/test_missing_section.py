"""The sections "What may be missing" and "Looks at the data" of the report, from a plain record."""

import numpy as np
import pytest
from findings_example import example

from plantfit.findings import Recording, read_findings
from plantfit.recording.looks.look import Look
from plantfit.report import render_html
from plantfit.report.figures import look_figure, residual_change_figure, share_figure

SENTENCE = (
    "A dead time of 0.200 ± 0.001 s on u explains 99 % of what is left (RMSE 2.21 to 0.0737 K): very likely missing."
)


def tried(name, explained, **more):
    return {
        "name": name,
        "unit": "s",
        "value": 0.2,
        "standard_error": None,
        "explained": explained,
        "rmse": 2.21,
        "rmse_with": 1.0,
        **more,
    }


def findings(found=("dead time of u",), untried=()):
    t = np.linspace(0, 30, 600)
    before = 2 * np.sin(2 * t) * np.exp(-((t % 5) / 2))
    rows = [
        tried("dead time of u", 0.9989, standard_error=0.001, unseen_rmse=1.58, unseen_rmse_with=0.0741),
        *(
            tried(f"{kind} of u", s)
            for kind, s in [("further lag", 0.94), ("dead zone", 0.31), ("backlash", 0.2), ("saturation", 0.02)]
        ),
        *(
            tried(name, s)
            for name, s in [("offset of y", 0.004), ("upper end of the sensor of y", 0.0), ("drift of y", 0.0)]
        ),
    ]
    diagnosis = {
        "state": "part" if untried else "whole",
        "verdict": [{"level": "warning", "sentence": SENTENCE, "figures": {}}],
        "rounds": [{"beside": [], "found": list(found), "untried": list(untried), "tried": rows}],
        "write": ["[model.extensions]", "dead_time = { u = [0, 1] }", "[parameters.dead_time_u]", "start = 0.2"]
        if found
        else [],
        "next": 'plantfit run study.toml --try "dead time of u"' if found else "",
        "with": ["dead time of u"],
        "residuals": [
            {
                "recording": "a",
                "output": "y",
                "unit": "K",
                "t": t.tolist(),
                "before": before.tolist(),
                "after": [None, *(0.03 * before)[1:]],
            }
        ],
    }
    look = {
        "kind": "clipped", "level": "warning", "recording": "a", "signal": "y", "begin": 3.25, "end": 17.5,
        "figures": {},
        "sentence": "y lies exactly at its upper end of 12 K in 60 samples.",
        "write": "extensions = { sensor_high = { y = [11, 13] } }",
    }  # fmt: skip
    return {**example(samples=300), "diagnosis": diagnosis, "data": [look]}


def test_the_report_shows_what_was_tried_and_where_the_data_are_odd():
    page = render_html(findings())
    for text in (
        "What may be missing",
        "Looks at the data",
        "99.9 %",
        "upper end of the sensor of y",
        "3.25 to 17.5 s",
        "sensor_high",
    ):
        assert text in page, text
    assert "--try &#34;dead time of u&#34;" in page
    assert "dead_time = { u = [0, 1] }" in page
    assert page.index('id="missing"') < page.index('id="data"') < page.index('id="fit"')
    assert "y in a" not in page  # the record has no recording of this name
    assert "not tried" in render_html(findings(untried=["lag of u"]))
    plain = render_html(example(samples=300))
    assert "What may be missing" not in plain
    assert "Looks at the data" not in plain


def test_nothing_named_writes_nothing():
    page = render_html(findings(found=()))
    assert "What to write into the study file" not in page
    assert "Or run it with that" not in page


def test_bars_and_residuals_are_those_of_the_record():
    record = read_findings(findings()).diagnosis
    assert record is not None
    (bars,) = share_figure(record.rounds[0])["data"]
    assert bars["y"][-1] == "dead time of u"  # on top
    assert bars["x"][-1] == 99.89
    assert bars["marker"]["color"][-1] != bars["marker"]["color"][0]
    before, after = residual_change_figure(record.residuals, 1000)["data"]
    assert max(abs(v) for v in before["y"]) > 1.5
    assert max(abs(v) for v in after["y"] if v is not None) < 0.06
    assert after["y"][0] is None


def test_a_step_or_a_pattern_stands_above_the_additions():
    record = read_findings(findings()).diagnosis
    assert record is not None
    told = {"step of K": 0.9985, "load step of x": 0.9984}
    steps = [{"name": name} for name in told]
    found = {**record.plain(), "stepping": {"steps": steps, "explained": 0.9985}}
    page = render_html({**findings(), "diagnosis": found})
    assert '"load step of x"' in page
    (bars,) = share_figure(record.rounds[0], told)["data"]
    assert bars["y"][-3:] == ["dead time of u", "load step of x", "step of K"]
    assert bars["x"][-2:] == [99.84, 99.85]
    assert len(set(bars["marker"]["color"][-2:])) == 1


T = np.arange(400) * 0.1
Y = np.sin(T)


def pictured(kind, begin, end, y=Y, signal: str | None = "y", t=T, times=(), figures=None):
    look = Look(kind, "info", "a", signal, ".", begin, end, times=list(times), figures=figures or {})
    values = [float(v) if np.isfinite(v) else None for v in y]
    output = {"unit": "V", "measured": values, "simulated": values}
    return look_figure(look, Recording.model_validate({"name": "a", "t": t.tolist(), "outputs": {"y": output}}))


def test_a_short_place_is_shaded_with_what_lies_beside_it():
    figure = pictured("stuck", 20.0, 23.0)
    assert figure is not None
    [line], [zone] = figure["data"], figure["layout"]["shapes"]
    assert (zone["x0"], zone["x1"]) == (20.0, 23.0)
    assert 14.0 < line["x"][0] < 17.0
    assert 26.0 < line["x"][-1] < 28.0
    assert figure["layout"]["annotations"][0]["text"] == "y in a [V]"


def test_single_samples_are_marked_and_a_gap_stays_one():
    figure = pictured("spikes", 0.5, 39.0, times=(0.5, 39.0))
    assert figure is not None
    line, marks = figure["data"]
    assert len(line["x"]) == 400
    assert marks["x"] == [0.5, 39.0]
    assert "shapes" not in figure["layout"]  # the place is all of the record
    missing = pictured("missing", 20.0, 23.0, np.where((T > 20) & (T < 23), np.nan, Y))
    assert missing is not None
    assert None in missing["data"][0]["y"]


def test_steps_of_the_clock_are_drawn_and_what_is_no_place_is_not():
    figure = pictured("gaps", 20.0, 23.0, signal=None, t=np.where(T > 20, T + 2.0, T))
    assert figure is not None
    assert max(figure["data"][0]["y"]) == 2.1
    assert pictured("look that failed", 0.0, 39.9) is None
    assert pictured("clipped", 0.0, 1.0, signal="nothing of it") is None


@pytest.mark.parametrize(("kind", "seconds", "low", "high", "end", "samples"), [
    ("short", 39.9, 60.0, 90.0, 60.0, 400), ("sampled slowly", 0.1, 0.001, 0.08, 0.08, 20),
    ("time unit", 0.1, 0.0001, 0.0008, 0.0008, 20),
    ("time unit", 39.9, 6000.0, 90000.0, 6000.0, 400),
])  # fmt: skip
def test_a_record_is_drawn_beside_the_time_that_the_model_asks_for(kind, seconds, low, high, end, samples):
    figure = pictured(kind, 0.0, 39.9, signal=None, figures={"seconds": seconds, "low": low, "high": high})
    assert figure is not None
    [line], [zone] = figure["data"], figure["layout"]["shapes"]
    assert (zone["x0"], zone["x1"]) == (0.0, pytest.approx(end))
    assert len(line["x"]) == samples
    assert figure["layout"]["annotations"][0]["text"].startswith("y in a [V]; shaded: at ")
    assert figure["layout"]["xaxis"]["range"][1] == pytest.approx(max(1.05 * end, line["x"][-1]))
    assert pictured(kind, 0.0, 39.9, signal=None) is None  # of a record without figures


def test_what_an_output_tells_of_an_input_is_drawn_beside_what_is_new_in_it():
    rng = np.random.default_rng(0)
    y = rng.normal(size=400)
    u = np.concatenate([[0.0], 2.0 * y[:-1]]) + 0.5 * rng.normal(size=400)  # a controller with noise of its own
    look = Look("feedback", "warning", "a", "u", ".", 0.0, 39.9, other="y")
    output = {"unit": "V", "measured": y.tolist(), "simulated": y.tolist()}
    recording = {
        "name": "a",
        "t": T.tolist(),
        "inputs": {"u": {"unit": "A", "values": u.tolist()}},
        "outputs": {"y": output},
    }
    figure = look_figure(look, Recording.model_validate(recording))
    assert figure is not None
    new, told = (np.array(line["y"], dtype=float) for line in figure["data"])
    assert np.corrcoef(new, told)[0, 1] > 0.9
    assert np.std(new - told) == pytest.approx(0.5, rel=0.2)
    assert (
        look_figure(Look("feedback", "warning", "a", "u", ".", 0.0, 39.9), Recording.model_validate(recording)) is None
    )


def test_levels_are_drawn_near():
    figure = pictured("quantised", 0.0, 39.9, np.round(Y / 0.25) * 0.25)
    assert figure is not None
    assert len(figure["data"][0]["x"]) == 120


def test_noise_of_an_input_is_drawn_on_its_longest_level():
    noise = 0.01 * np.random.default_rng(0).normal(size=len(T))
    steps = np.where(np.arange(len(T)) < 150, 0.0, np.where(np.arange(len(T)) < 300, 5.0, 2.0))
    figure = pictured("noisy", 0.0, 39.9, steps + noise, figures={"step": 0.01})
    assert figure is not None
    drawn = np.array(figure["data"][0]["y"], dtype=float)
    assert len(drawn) == max(150, len(T) - 300)
    assert np.ptp(drawn) < 0.1
    # one that moves all the time, whose noise the study states, has no level
    figure = pictured("noisy", 0.0, 39.9, 5.0 * np.sin(T) + noise, figures={"step": 1e-4})
    assert figure is not None
    assert len(figure["data"][0]["x"]) == 120
