import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest
from findings_example import example

from plantfit.findings import History, Parameter, read_findings
from plantfit.findings.diagnosis import ResidualChange
from plantfit.findings.results.models_compared import ModelSeries
from plantfit.report import figures
from plantfit.report.figures import style
from plantfit.report.figures.comparison.models import overlay_figure
from plantfit.report.figures.convergence import cost_at
from plantfit.report.figures.missing import residual_change_figure
from plantfit.report.figures.parameters import position


@pytest.fixture(scope="module")
def record():
    return read_findings(example(samples=300))


def every_figure(record):
    yield from (figures.fit_figure(r, 100) for r in record.recordings)
    for test in record.residual_tests:
        yield figures.stem_figure(np.array(test.lags_s), np.array(test.autocorrelation), test.bound, "autocorrelation")
    yield figures.interval_figure(record.parameters, record.runs)
    yield from (figures.weight_figure(c) for c in record.combinations)
    yield figures.convergence_figure(record.runs)
    yield figures.waterfall_figure(record.runs)


def test_every_figure_is_called_by_a_test():
    tests = "".join(p.read_text("utf-8") for p in Path(__file__).parent.glob("test_*.py"))
    assert [name for name in figures.__all__ if name.endswith("_figure") and f"{name}(" not in tests] == []


def test_plotly_accepts_every_figure(record):
    for figure in every_figure(record):
        text = re.sub(r"var\(--[a-z0-9-]+\)", "#123456", json.dumps(figure, allow_nan=False))
        assert go.Figure(json.loads(text)).data  # raises for a key or value that plotly does not know


def test_every_colour_is_defined_in_the_style_sheet(record):
    from importlib import resources

    css = resources.files("plantfit.report").joinpath("templates", "style.css").read_text()
    light, dark = css.split("@media (prefers-color-scheme: dark)")
    used = {
        name for figure in every_figure(record) for name in re.findall(r"var\((--[a-z0-9-]+)\)", json.dumps(figure))
    }
    assert used
    for name in used:
        assert f"{name}:" in light
        assert f"{name}:" in dark


def test_residual_is_measured_minus_simulated(record):
    recording = record.recordings[0]
    data = figures.fit_figure(recording, 1000)["data"]
    measured, simulated, residual = (np.array(line["y"], dtype=float) for line in data[:3])
    assert np.allclose(residual, measured - simulated, atol=2e-3, equal_nan=True)
    assert np.isnan(residual).sum() == 10


@pytest.mark.parametrize(("every", "drawn"), [(1, "lines"), (2, "markers"), (10, "markers")])
def test_samples_that_stand_alone_are_drawn_as_points(every, drawn):
    """A line between two missing samples is nothing: an output measured at every tenth row was not to be seen."""
    values = np.full(4000, np.nan)
    values[::every] = 1.0
    assert style.dots(values, "red").get("mode", "lines") == drawn
    assert style.dots(np.r_[values, np.ones(4000)], "red").get("mode", "lines") == "lines"  # most have a neighbour
    assert style.dots(values[: 100 * every], "red", few=100)["mode"] == "markers"
    assert style.dots(np.full(5, np.nan), "red") == {}


def test_all_time_axes_are_linked_and_panels_do_not_overlap(record):
    layout = figures.fit_figure(record.recordings[0], 100)["layout"]
    axes = sorted(k for k in layout if k.startswith("xaxis"))
    assert len(axes) == 5  # two outputs with residuals, one input
    assert all(layout[k].get("matches") == "x" for k in axes if k != "xaxis")
    domains = sorted(layout[k]["domain"] for k in layout if k.startswith("yaxis"))
    assert all(below[1] < above[0] for below, above in pairwise(domains))
    assert domains[0][0] == 0
    assert domains[-1][1] == 1


def test_zones_cover_fit_and_validation(record):
    recording = record.recordings[0]
    shapes = figures.fit_figure(recording, 100)["layout"]["shapes"]
    first = [s for s in shapes if s["xref"] == "x"]
    assert [(s["x0"], s["x1"]) for s in first] == [(0.0, pytest.approx(2.1)), (pytest.approx(2.1), pytest.approx(2.99))]
    assert [s["label"]["text"] for s in first] == ["fit", "validation"]


def test_stems_outside_the_bound_are_apart():
    values = np.array([0.0, 0.5, -0.6, 0.05, -0.05])
    inside, outside = figures.stem_figure(np.arange(5.0), values, 0.1, "x")["data"]
    assert [v for v in outside["y"][1::3]] == [0.5, -0.6]
    assert [v for v in inside["y"][1::3]] == [0.0, 0.05, -0.05]


@pytest.mark.parametrize(("timed", "of_rows", "of_lags"), [(True, "time [s]", "lag [s]"), (False, "row", "lag [rows]")])
def test_rows_without_times_are_over_no_seconds(record, timed, of_rows, of_lags):
    fit = figures.fit_figure(record.recordings[0].model_copy(update={"timed": timed}), 100)["layout"]
    assert {a["title"]["text"] for k, a in fit.items() if k.startswith("xaxis") and a["title"]["text"]} == {of_rows}
    stems = figures.stem_figure(np.arange(5.0), np.zeros(5), 0.1, "x", timed)
    assert stems["layout"]["xaxis"]["title"]["text"] == of_lags
    assert (" rows:" in stems["data"][0]["hovertemplate"]) is not timed
    t, y = [0.0, 1.0, 2.0], [1.0, 2.0, 3.0]
    models = ModelSeries(
        recording="r", output="y", unit=None, t=t, measured=y, part=["fit", "fit", "fit"], simulated={"a": y},
        timed=timed,
    )  # fmt: skip
    assert overlay_figure(models, ["a"], 100)["layout"]["xaxis2"]["title"]["text"] == of_rows
    changed = ResidualChange(recording="r", output="y", t=t, before=y, after=y, timed=timed)
    assert residual_change_figure([changed], 100)["layout"]["xaxis"]["title"]["text"] == of_rows


@pytest.mark.parametrize("factor", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize(("scale", "middle"), [("linear", 50.5), ("log", 10.0)])
def test_position_between_bounds_does_not_depend_on_the_unit(scale, middle, factor):
    p = Parameter(name="a", value=1.0, lower_bound=1.0 * factor, upper_bound=100.0 * factor, scale=scale)
    assert position(p, 1.0 * factor) == pytest.approx(0.0, abs=1e-12)
    assert position(p, middle * factor) == pytest.approx(0.5)
    assert position(p, 100.0 * factor) == pytest.approx(1.0)


def test_interval_below_zero_on_a_log_scale_ends_at_the_bound():
    p = Parameter(name="a", value=2.0, low=-1.0, high=5.0, lower_bound=1.0, upper_bound=100.0, scale="log")
    interval = figures.interval_figure([p], [])["data"][1]
    assert interval["x"][0] == 0.0


def test_best_cost_is_a_step_function():
    at = cost_at(np.array([2.0, 5.0, 9.0]), np.array([8.0, 4.0, 1.0]), np.array([1.0, 2.0, 4.9, 5.0, 100.0]))
    assert np.array_equal(at, [np.nan, 8.0, 8.0, 4.0, 1.0], equal_nan=True)


def test_median_band_only_for_five_runs_or_more(record):
    names = [line.get("name", "") for line in figures.convergence_figure(record.runs)["data"]]
    assert "pso: median of 6, quartiles" in names
    assert not any(name.startswith("lm: median") for name in names)


def test_cost_of_zero_falls_back_to_a_linear_axis(record):
    run = record.runs[0].model_copy(update={"history": History(evaluations=[1, 2], cost=[1.0, 0.0])})
    assert "type" not in figures.convergence_figure([run])["layout"]["yaxis"]


def test_waterfall_is_sorted(record):
    dots = [
        (x, y)
        for line in figures.waterfall_figure(record.runs)["data"]
        for x, y in zip(line["x"], line["y"], strict=True)
    ]
    assert [x for x, _ in sorted(dots)] == list(range(1, 9))
    assert [y for _, y in sorted(dots)] == sorted(y for _, y in dots)


def test_long_names_of_categories_stand_in_lines_and_are_no_markup():
    axis = style.categories(["CMA-ES", "least squares, exact, random starts", "a<b>"])
    assert axis["tickvals"] == ["CMA-ES", "least squares, exact, random starts", "a&lt;b&gt;"]
    assert axis["ticktext"] == ["CMA-ES", "least squares,<br>exact, random<br>starts", "a&lt;b&gt;"]


@pytest.mark.parametrize(
    ("names", "rows"), [(["PSO", "CGA"], 1), (["least squares, exact, random starts"] * 4, 2), ([], 1)]
)
def test_a_legend_of_several_rows_has_room_above(names, rows):
    plain = style.layout(340)
    assert style.with_legend(plain, names)["margin"]["t"] == plain["margin"]["t"] + 20 * (rows - 1)
    assert plain == style.layout(340)
