"""Tables of parameters in the report: figures with the right numbers, long lists folded, the record checked."""

import json
import math

import pytest
from findings_example import example

from plantfit.errors import PlantfitError
from plantfit.findings import read_findings
from plantfit.report import render_html, summary_text
from plantfit.report.figures import table_figure
from plantfit.report.sections.tables import basins_table, entries_tables

NODES = [0.0, 5.0, 10.0, 20.0]
STATES = ["determined", "weak", "at bound", "flat"]


def table(recording: str | None = "high", over=("y",), nodes=(NODES,), **changes):
    n = math.prod(map(len, nodes))
    base = [1.0 + 0.1 * k for k in range(n)]
    status = [STATES[k % 4] for k in range(n)]
    sure = [s != "at bound" for s in status]
    return {
        "name": "k", "unit": "bar/%", "over": list(over), "over_units": ["bar"] * len(over),
        "nodes": [list(v) for v in nodes],
        "recording": recording, "values": base, "status": status,
        "low": [v - 0.2 if s else None for v, s in zip(base, sure, strict=True)],
        "high": [v + (9.0 if k % 4 == 3 else 0.3) if s else None for k,
                 (v, s) in enumerate(zip(base, sure, strict=True))],
    } | changes  # fmt: skip


def entry(k, recording="high"):
    return {
        "name": f"k[{k}][{recording}]", "parameter": "k", "recording": recording, "index": [k], "unit": "bar/%",
        "value": 1.0 + 0.1 * k,
        "standard_error": 0.1, "low": 0.8, "high": 1.2, "lower_bound": 0.0, "upper_bound": 2.0, "status": STATES[k % 4],
    }  # fmt: skip


def findings(recordings=("high", "low"), entries=4):
    record = example(60)
    record["tables"] = [table(r) for r in recordings]
    record["parameters"] += [entry(k, r) for r in recordings for k in range(entries)]
    return record


def figure(*tables):
    return table_figure(read_findings({"name": "x", "tables": list(tables)}).tables)


def test_every_entry_is_drawn_once_at_its_node_with_its_interval():
    drawn = figure(table())
    points = [t for t in drawn["data"] if t["mode"] == "markers" and t["x"] != [None]]
    found = {(x, y): (up, down) for t in points for x, y, up, down in _bars(t)}
    assert set(found) == set(zip(NODES, [1.0, 1.1, 1.2, 1.3], strict=True))
    assert found[0.0, 1.0] == (pytest.approx(0.3), pytest.approx(0.2))
    assert found[10.0, 1.2] == (0.0, 0.0)  # on a bound: no interval
    assert drawn["layout"]["xaxis"]["title"]["text"] == "y [bar]"
    assert drawn["layout"]["yaxis"]["title"]["text"] == "k [bar/%]"


def _bars(trace):
    return zip(trace["x"], trace["y"], trace["error_y"]["array"], trace["error_y"]["arrayminus"], strict=True)


def test_what_is_not_determined_is_grey_unconnected_and_does_not_stretch_the_figure():
    drawn = figure(table())
    line = next(t for t in drawn["data"] if t["mode"] == "lines")
    assert line["y"] == [1.0, 1.1, 1.2, None]
    grey = [t for t in drawn["data"] if t.get("marker", {}).get("symbol") == "circle-open" and t["x"] != [None]]
    assert [t["x"] for t in grey] == [[20.0]]
    low, high = drawn["layout"]["yaxis"]["range"]
    assert low < 0.8
    assert 1.4 < high < 2.0
    assert [t["name"] for t in drawn["data"] if t["x"] == [None]] == ["not determined", "on a bound"]


def test_recordings_stand_side_by_side_and_keep_their_nodes_in_words():
    drawn = figure(*(table(f"r{k}") for k in range(10)))
    lines = [t for t in drawn["data"] if t["mode"] == "lines"]
    places = [t["x"][1] for t in lines]
    assert [t["name"] for t in lines] == [f"r{k}" for k in range(10)]
    assert len(set(places)) == 10
    assert sum(places) / 10 == pytest.approx(5.0)
    assert max(places) - min(places) < 5.0  # less than to the next node
    words = [text for t in drawn["data"] for text in t.get("text", ())]
    assert sum("y = 5 bar" in w for w in words) == 10


def test_over_two_signals_there_is_a_line_for_each_node_of_the_first():
    nodes = ([1.0, 2.0, 3.0], NODES)
    drawn = figure(table(None, ("y", "u"), nodes))
    lines = [t for t in drawn["data"] if t["mode"] == "lines"]
    assert [t["name"] for t in lines] == ["y = 1 bar", "y = 2 bar", "y = 3 bar"]
    assert lines[1]["y"][:3] == [1.4, 1.5, 1.6]


def test_a_scale_of_the_values_scales_the_figure():
    one, ten = figure(table()), figure(_times(table(), 10.0))
    for a, b in zip(one["data"], ten["data"], strict=True):
        assert [v if v is None else pytest.approx(10 * v) for v in a.get("y", [])] == b.get("y", [])


def _times(row, factor):
    return row | {key: [None if v is None else factor * v for v in row[key]] for key in ("values", "low", "high")}


def test_the_report_folds_entries_and_keeps_single_parameters_in_sight():
    page = render_html(findings(entries=40))
    assert "All 80 entries of k: 20 determined, 20 weak, 20 flat, 20 at bound" in page
    visible = page.split("<details>")[0]
    assert "Kt" in visible
    assert "k[3][high]" not in visible
    figures = json.loads(page.split('id="figures">')[1].split("</script>")[0])
    assert any(f["layout"]["yaxis"]["title"]["text"] == "k [bar/%]" for f in figures.values())


def test_many_parameters_do_not_make_a_wide_table_of_minima():
    names = [f"k[{k}]" for k in range(300)]
    basins = [
        {"cost": c, "runs": 1, "share": 0.5, "parameters": {n: 1.0 + c * (k in (7, 9)) for k, n in enumerate(names)}}
        for c in (1, 2)
    ]
    shown = basins_table(read_findings({"name": "x", "basins": basins}).basins)
    assert len(shown.head) == 3 + 8
    assert {"k[7]", "k[9]"} <= set(shown.head)
    assert "8 parameters that differ most" in shown.caption


def test_the_text_has_one_line_for_each_table():
    text = summary_text(findings(entries=40))
    assert "k[3]" not in text
    row = next(line for line in text.split("\n") if line.startswith("k ") and "high" in line)
    assert "40" in row
    assert "10 determined, 10 weak, 10 flat, 10 at bound" in row


def test_entries_are_counted_by_table():
    (shown,) = entries_tables(read_findings(findings()).parameters)
    assert len(shown.rows) == 8
    assert len(shown.marked) == 6


WRONG = [
    ({"values": [1.0]}, "values has 1 entries but the nodes make 4"),
    ({"nodes": []}, "over names 1 signals but there are 0 lists of nodes"),
    ({"status": 3}, "tables.0.status"),
]


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_a_record_that_contradicts_itself_is_refused(change, message):
    with pytest.raises(PlantfitError, match=message):
        render_html({"name": "x", "tables": [table(**change)]})
